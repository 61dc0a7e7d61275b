"""Cases and suites on disk. The layout is that of `docs/file-formats.md`, which is a contract.

A case is a folder written under a temporary name and renamed, so a killed run leaves none
half-written. Its maps lie once per suite in `../maps`, named by their content. Loading checks
schema, shapes and a content hash and never unpickles.

The rename also decides what the manifest lists: it names the case that is `pending` before, with
its hash, and a reader counts that one if the folder holds it.
"""

import hashlib
import io
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
import shapely

from regents_cosim.cases.array_files import load_arrays
from regents_cosim.cases.map_files import MapFiles, is_map_file, load_map, map_files, save_map
from regents_cosim.cases.shipped import SUITES, located, names
from regents_cosim.checks.bounded import MIB, read_bounded
from regents_cosim.checks.names import require_file_name, require_inside, require_no_link
from regents_cosim.errors import CaseError, InputError, ScenarioError, require
from regents_cosim.judgement import Judgement
from regents_cosim.scenario import Agent, AttackRecord, Overlap, Provenance, Scenario, Signal, Tracks
from regents_cosim.system.atomic import clear_leftovers, explain_write, new_folder, write_atomic
from regents_cosim.system.locks import writing
from regents_cosim.system.swap import restore

SCHEMA = 2  # the newest that is read: cases with heights
_FLAT_SCHEMA = 1  # of everything else; their bytes and hashes are those of the versions that knew no heights
MANIFEST = "suite.json"
HEADER = "scenario.json"
CASE_FILES = frozenset({HEADER, "tracks.npz", "original.npz", "evasion.npz", "still.png"})
_JSON_BYTES = 64 * MIB  # of a case 100 KB, the costs of every iteration included; of a suite 100 bytes a case
_Kind = TypeVar("_Kind")


@dataclass(frozen=True)
class Header:
    """scenario.json, except for `schema`: all of a case but its tracks and its map."""

    id: str
    hash: str
    dt: float
    ego: str
    target: tuple[float, float]
    agents: tuple[Agent, ...]
    map: MapFiles
    signals: tuple[Signal, ...]
    overlaps: tuple[Overlap, ...]
    provenance: Provenance
    attack: AttackRecord | None
    judgement: Judgement | None = None

    def __post_init__(self) -> None:
        require_file_name(self.id, "case id")


@dataclass(frozen=True)
class SuiteEntry:
    """One case of a suite."""

    case: str
    hash: str

    def __post_init__(self) -> None:
        require_file_name(self.case, "case of a suite")


@dataclass(frozen=True)
class Suite:
    """suite.json: what a folder of cases holds and how it was made."""

    cases: tuple[SuiteEntry, ...]
    command: str = ""
    seed: int = 0
    versions: dict[str, str] = field(default_factory=dict)
    schema: int = _FLAT_SCHEMA
    pending: SuiteEntry | None = None  # about to be written: of the suite if its folder holds it

    def having(self, entry: SuiteEntry) -> "Suite":
        """With `entry` in the place of one of its name, and nothing pending."""
        entries = {one.case: one for one in (*self.cases, entry)}
        return replace(self, cases=tuple(entries[name] for name in sorted(entries)), pending=None)


def save_case(scenario: Scenario, suite: Path | str) -> Path:
    """Write `scenario` to `suite/<id>`, replacing a case of that name; return its folder. The manifest stays as it is.

    Raises RegentsError where the folder cannot be written.
    """
    folder = Path(suite)
    with explain_write(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with writing(folder):
            return _write_case(scenario, folder, content_hash(scenario))


def add_case(scenario: Scenario, suite: Path, notes: Suite) -> Path:
    """Write `scenario` to `suite/<id>` and list it in the manifest beside what that lists by then; return its folder.

    The manifest then says of itself what `notes` says. Raises RegentsError where the folder cannot be written.
    """
    entry = SuiteEntry(scenario.id, content_hash(scenario))
    with explain_write(suite):
        suite.mkdir(parents=True, exist_ok=True)
        with writing(suite):
            known = load_manifest(suite).cases if (suite / MANIFEST).exists() else ()
            manifest = replace(notes, cases=known, pending=entry)
            saved = _write_case(scenario, suite, entry.hash, lambda: save_suite(suite, manifest))
            save_suite(suite, manifest.having(entry))
    return saved


def is_ours(suite: Path, path: Path) -> bool:
    """Whether a file at `path` in a suite is of the suite itself; all others are the user's."""
    if len(path.parts) != 2:
        return path == Path(MANIFEST)
    folder, name = path.parent, path.name
    return folder.name == "maps" if is_map_file(name) else is_of_case(suite / folder, Path(name))


def is_of_case(case: Path, path: Path) -> bool:
    """Whether a file at `path` in the folder of a case is of the case itself."""
    return path.as_posix() in CASE_FILES and (case / HEADER).exists()


def _write_case(scenario: Scenario, suite: Path, digest: str, ready: Callable[[], None] = lambda: None) -> Path:
    """Write a case into a suite that is locked; `ready` is called when it only has to be put in its place."""
    with explain_write(suite):
        clear_leftovers(suite)
        files = save_map(scenario.road, suite / "maps")
        with new_folder(require_no_link(suite / scenario.id), is_of_case) as folder:
            (folder / "tracks.npz").write_bytes(_pack_tracks(scenario.tracks))
            if scenario.original is not None:
                (folder / "original.npz").write_bytes(_pack_tracks(scenario.original))
            if scenario.evasion is not None:
                (folder / "evasion.npz").write_bytes(_pack_tracks(scenario.evasion))
            header = _header(scenario, files, digest)
            text = msgspec.json.encode({"schema": _schema(scenario)} | msgspec.to_builtins(header))
            (folder / HEADER).write_bytes(msgspec.json.format(text, indent=1) + b"\n")
            ready()
    return suite / scenario.id


def load_case(folder: Path) -> Scenario:
    """Read a case exactly as it was saved.

    Raises CaseError with what was found and expected where a file is missing, truncated, of
    a newer schema, or does not match its content hash.
    """
    header = load_header(folder)
    with _explain_read(folder):
        scenario = Scenario(
            id=header.id,
            dt=header.dt,
            agents=header.agents,
            tracks=_load_tracks(folder / "tracks.npz"),
            target=header.target,
            road=load_map(header.map, folder),
            provenance=header.provenance,
            signals=header.signals,
            overlaps=header.overlaps,
            attack=header.attack,
            original=_load_tracks(folder / "original.npz") if header.attack else None,
            judgement=header.judgement,
            evasion=_load_tracks(folder / "evasion.npz") if _avoidable(header.judgement) else None,
        )
    if header.ego != scenario.ego.id:
        raise CaseError(f"{folder}: ego is {header.ego!r} but the first agent is {scenario.ego.id!r}")
    found = content_hash(scenario)
    if found != header.hash:
        raise CaseError(
            f"{folder}: content hash {found[:12]}, expected {header.hash[:12]} (was a file of the case changed?)"
        )
    return scenario


def load_header(folder: Path) -> Header:
    """What a case says of itself; reads neither tracks nor maps and checks no hash. Raises CaseError."""
    restore(folder)
    path = folder / HEADER
    if not path.exists():
        raise CaseError(f"no {HEADER} in {folder} (expected a case folder)")
    _require_own(folder)
    with _explain_read(folder):
        return _decode(read_bounded(path, _JSON_BYTES), Header, path)


def _require_own(folder: Path) -> None:
    """Raise CaseError where a file of a case is a link out of its suite, or out of the case where that is alone."""
    suite = folder.parent if (folder.parent / "suite.json").is_file() else folder
    for name in ("scenario.json", "tracks.npz", "original.npz", "evasion.npz"):
        require_inside(folder / name, suite)


def content_hash(scenario: Scenario) -> str:
    """SHA-256 of everything that a replay depends on: all but the provenance, and what the search took."""
    digest = hashlib.sha256()
    content = _header(scenario, map_files(scenario.road), "")
    for name in ("id", "dt", "target", "agents", "map", "signals", "overlaps"):
        digest.update(msgspec.json.encode(getattr(content, name), order="deterministic"))
    digest.update(_attack_content(scenario.attack))
    if scenario.judgement is not None:
        digest.update(_judgement_content(scenario.judgement))
    for tracks in filter(None, (scenario.tracks, scenario.original, scenario.evasion)):
        for name, value in _arrays(tracks).items():
            digest.update(name.encode() + (b"-" if value is None else value.tobytes()))
    return digest.hexdigest()


def save_suite(folder: Path, suite: Suite) -> None:
    """Write the manifest of a suite."""
    values = msgspec.to_builtins(suite)
    if suite.pending is None:
        del values["pending"]
    with explain_write(folder):
        write_atomic(folder / MANIFEST, msgspec.json.format(msgspec.json.encode(values), indent=1) + b"\n")


def load_manifest(folder: Path) -> Suite:
    """Read the manifest of a suite. Raises CaseError where there is none that can be read."""
    restore(folder)
    path = folder / MANIFEST
    if not path.exists():
        raise CaseError(f"no suite.json in {folder} (expected a folder of cases; make one with `regents record`)")
    require_inside(path, folder)
    with _explain_read(folder):
        suite = _decode(read_bounded(path, _JSON_BYTES), Suite, path)
    return _settled(suite, folder)


def _settled(suite: Suite, folder: Path) -> Suite:
    """The suite with nothing pending: a writer may have been killed before or after it put the case in its place."""
    if suite.pending is None:
        return suite
    try:
        there = load_header(folder / suite.pending.case).hash == suite.pending.hash
    except CaseError:
        there = False
    return suite.having(suite.pending) if there else replace(suite, pending=None)


def find_cases(path: Path) -> list[Path]:
    """The case folders that `path` stands for: itself, or those its manifest lists, in that order."""
    path = located(path)
    restore(path)
    if not path.is_dir():
        raise CaseError(
            f"{path} is not a folder (expected a case, a folder of cases, or one that comes with regents_cosim: "
            f"{', '.join(names(SUITES))})"
        )
    if (path / HEADER).is_file():
        return [path]
    return [path / entry.case for entry in load_manifest(path).cases]


# --- one case ---------------------------------------------------------------------------------


def _schema(scenario: Scenario) -> int:
    tracks = filter(None, (scenario.tracks, scenario.original, scenario.evasion))
    return SCHEMA if scenario.road.raised or not all(track.flat for track in tracks) else _FLAT_SCHEMA


def _header(scenario: Scenario, files: MapFiles, digest: str) -> Header:
    return Header(
        id=scenario.id,
        hash=digest,
        dt=scenario.dt,
        ego=scenario.ego.id,
        target=scenario.target,
        agents=scenario.agents,
        map=files,
        signals=scenario.signals,
        overlaps=scenario.overlaps,
        provenance=scenario.provenance,
        attack=scenario.attack,
        judgement=scenario.judgement,
    )


def _avoidable(judgement: Judgement | None) -> bool:
    """Whether a case keeps the track that avoids its collision."""
    return bool(judgement and judgement.avoidability and judgement.avoidability.avoidable)


def _attack_content(attack: AttackRecord | None) -> bytes:
    """What is hashed of an attack: not what it took; what older cases do not say, only where it holds."""
    values = msgspec.json.decode(msgspec.json.encode(attack, order="deterministic"))
    if values is not None:
        values.pop("act_time", None)  # a record that was read lacks what its file does not say
        values.pop("rollouts", None)
        for name in ("planner_error", "spoilt"):
            if not values.get(name):
                values.pop(name, None)
    return msgspec.json.encode(values)


def _judgement_content(judgement: Judgement) -> bytes:
    """What is hashed of a judgement: what older cases do not say, only where it is known."""
    values = msgspec.json.decode(msgspec.json.encode(judgement, order="deterministic"))
    _drop_unknown(values, ("law", "drivers", "unavoidable", "usual"))
    for drive in values.get("drivers", ()):
        _drop_unknown(drive, ("rear_ended_by",))
    if (avoidability := values.get("avoidability")) is not None:
        _drop_unknown(avoidability, ("in_time", "perceived_step"))
        if (gentlest := avoidability.get("gentlest")) is not None:
            _drop_unknown(gentlest, ("side", "runs_red", "driver"))
    return msgspec.json.encode(values)


def _drop_unknown(values: dict[str, Any], names: tuple[str, ...]) -> None:
    """Drop those of `names` that say nothing: older cases lack them."""
    for name in names:
        if values.get(name) is None or values[name] == []:
            values.pop(name, None)


def _decode(text: bytes, kind: type[_Kind], path: Path) -> _Kind:
    """Decode JSON of our schema or an older one into `kind`."""
    schema = msgspec.json.decode(text, type=_Schema).schema
    if schema > SCHEMA:
        raise CaseError(
            f"{path}: schema {schema}, this version reads up to {SCHEMA} (upgrade regents_cosim to read it)"
        )
    return msgspec.json.decode(text, type=kind)


def _pack_tracks(tracks: Tracks) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **{name: value for name, value in _arrays(tracks).items() if value is not None})
    return buffer.getvalue()


def _arrays(tracks: Tracks) -> dict[str, Any]:
    """What is kept of tracks: all but heights that are 0."""
    arrays = {f.name: getattr(tracks, f.name) for f in fields(tracks)}
    if tracks.flat:
        arrays.pop("z")
    return arrays


def _load_tracks(path: Path) -> Tracks:
    arrays = load_arrays(path, {f.name for f in fields(Tracks)})
    missing = sorted({f.name for f in fields(Tracks) if f.default is MISSING} - set(arrays))
    require(not missing, f"{path}: arrays {missing} are missing", InputError)
    return Tracks(**arrays)


# --- reading safely ---------------------------------------------------------------------------


@dataclass(frozen=True)
class _Schema:
    schema: int


@contextmanager
def _explain_read(folder: Path) -> Iterator[None]:
    try:
        yield
    except CaseError:
        raise
    except (ScenarioError, InputError) as error:
        named = str(folder) in str(error)
        raise CaseError(str(error) if named else f"{folder}: {error}") from error
    except _UNREADABLE as error:
        raise CaseError(
            f"{folder}: a file of the case is missing, damaged or truncated ({_first_line(error)})"
        ) from error


_UNREADABLE: tuple[type[Exception], ...] = (
    OSError, EOFError, ValueError, TypeError, KeyError, MemoryError, zipfile.BadZipFile, zlib.error,
    msgspec.MsgspecError, shapely.errors.ShapelyError, RecursionError,
)  # fmt: skip


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
