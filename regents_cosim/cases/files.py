"""Cases on disk, in the layout of `docs/file-formats.md`, which is a contract.

A case is a folder that is written under a temporary name and then renamed, so a killed run leaves no half-written one.
Its maps lie once per suite in `../maps`, named by their content. Loading checks schema, shapes and a content hash, and
never unpickles.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from regents_cosim.cases.content_hash import FormerVerdict, hash_as_stored, up_to_date
from regents_cosim.cases.header import HEADER, Behaviour, Header, header_of, schema_of
from regents_cosim.cases.json_files import JSON_BYTES, decode, explain_read, in_lines
from regents_cosim.cases.map_files import load_map, save_map
from regents_cosim.cases.shipped import located
from regents_cosim.cases.track_files import load_tracks, pack_tracks
from regents_cosim.checks.bounded import read_bounded
from regents_cosim.checks.names import require_inside, require_no_link
from regents_cosim.errors import CaseError
from regents_cosim.scenario.judgement import Holds
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.system.files.atomic import clear_leftovers, explain_write, new_folder, write_atomic
from regents_cosim.system.files.swap import restore

STILL = "still.png"
_LOG, _FORMER_LOG = "log.npz", "original.npz"  # the former name is read, and never written
_EVASION = "evasion.npz"
_WRITTEN = frozenset({HEADER, "tracks.npz", _LOG, _EVASION})
_READ = _WRITTEN | {_FORMER_LOG}
CASE_FILES = _READ | {STILL}


def is_of_case(case: Path, path: Path) -> bool:
    """Whether the file `path`, relative to the folder of a case, belongs to the case itself."""
    return path.as_posix() in CASE_FILES and (case / HEADER).exists()


def write_case(
    scenario: Scenario,
    tags: tuple[str, ...],
    behaviour: Behaviour | None,
    suite: Path,
    digest: str,
    ready: Callable[[], None] = lambda: None,
    listed: bool = False,
) -> Path:
    """Write a case into a locked suite; `ready` is called just before the case is moved to its place.

    `tags` and `behaviour` are not part of the hash, for they follow from the rest. Raises CaseError where foreign files
    have its place. `listed` says that the files there belong to a case of the suite.
    """
    with explain_write(suite):
        clear_leftovers(suite)
        place = require_no_link(suite / scenario.id)
        if not listed:
            _require_free(place)
        files = save_map(scenario.road, suite / "maps")
        with new_folder(place, is_of_case) as folder:
            (folder / "tracks.npz").write_bytes(pack_tracks(scenario.tracks))
            if scenario.log is not None:
                (folder / _LOG).write_bytes(pack_tracks(scenario.log))
            if scenario.evasion is not None:
                (folder / _EVASION).write_bytes(pack_tracks(scenario.evasion))
            header = replace(header_of(scenario, files, digest), tags=tags, behaviour=behaviour)
            (folder / HEADER).write_bytes(in_lines({"schema": schema_of(scenario)} | msgspec.to_builtins(header)))
            ready()
    return place


def note_holds(folder: Path, holds: Holds) -> None:
    """Note in a judged case whether its crash holds, which is not part of its hash."""
    values = msgspec.json.decode(read_bounded(folder / HEADER, JSON_BYTES))
    values["judgement"]["holds"] = msgspec.to_builtins(holds)
    with explain_write(folder):
        write_atomic(folder / HEADER, in_lines(values))


def _require_free(folder: Path) -> None:
    """Raise CaseError where a new case would overwrite something that is not a case."""
    restore(folder)
    taken = [path for name in sorted(_READ) if os.path.lexists(path := folder / name)]
    if os.path.lexists(folder) and not folder.is_dir():
        taken = [folder]
    if not taken:
        return
    try:
        load_header(folder)
    except CaseError as error:
        raise CaseError(
            f"{taken[0]} is of no case that this suite lists, so it is left as it is (move it away, or choose another "
            "folder with -o)"
        ) from error


def load_case(folder: Path | str) -> Scenario:
    """Read a case exactly as it was saved, from a folder or from `shipped:standard/NAME`.

    Raises CaseError, with what was found and expected, where a file is missing, truncated, of a newer schema, or does
    not match the content hash.
    """
    folder = located(Path(folder))
    header = load_header(folder)
    with explain_read(folder):
        former, evasion = _former_verdict(folder, header), _evasion(folder, header)
        careful = header.judgement is not None and header.judgement.evades_s is not None and not former.evades_otherwise
        scenario = Scenario(
            id=header.id,
            dt=header.dt,
            agents=header.agents,
            tracks=load_tracks(folder / "tracks.npz"),
            target=header.target,
            road=load_map(header.map, folder),
            provenance=header.provenance,
            signals=header.signals,
            overlaps=header.overlaps,
            attack=header.attack,
            log=load_tracks(_log_of(folder)) if header.attack else None,
            judgement=header.judgement,
            evasion=evasion if careful else None,  # that of any other manoeuvre than the careful driver's is not read
        )
    if header.ego != scenario.ego.id:
        raise CaseError(f"{folder}: ego is {header.ego!r} but the first agent is {scenario.ego.id!r}")
    found = hash_as_stored(scenario, former, evasion)
    if found != header.hash:
        raise CaseError(
            f"{folder}: content hash {found[:12]}, expected {header.hash[:12]} (was a file of the case changed?)"
        )
    return scenario


def load_header(folder: Path) -> Header:
    """Read the header of a case, neither tracks nor maps, and check no hash. Raises CaseError.

    In a suite a case has the name of its folder, so that results, baselines and messages mean the same case.
    """
    restore(folder)
    path = folder / HEADER
    if not path.exists():
        raise CaseError(f"no {HEADER} in {folder} (expected a case folder)")
    _require_own(folder)
    with explain_read(folder):
        header = decode(read_bounded(path, JSON_BYTES), Header, path)
    _require_own_name(folder, header.id)
    return header if header.attack is None else replace(header, attack=up_to_date(header.attack))


def _in_suite(folder: Path) -> bool:
    return (folder.parent / "suite.json").is_file()


def _require_own_name(folder: Path, name: str) -> None:
    """Raise CaseError where a case in a suite has another name than its folder."""
    place = Path(os.path.abspath(folder))
    if _in_suite(place) and place.name != name:
        raise CaseError(f"{folder}: the case calls itself {name}, expected the name of its folder (rename that)")


def _require_own(folder: Path) -> None:
    """Raise CaseError where a file of a case is a link out of its suite, or out of the case if that is in no suite."""
    suite = folder.parent if _in_suite(folder) else folder
    for name in sorted(_READ):
        require_inside(folder / name, suite)


def _log_of(case: Path) -> Path:
    """The file with the log, by the name that it has in this case."""
    former = case / _FORMER_LOG
    return former if former.is_file() and not (case / _LOG).exists() else case / _LOG


def _evasion(case: Path, header: Header) -> Tracks | None:
    """The stored track that avoids the collision; older versions stored one without the careful driver too."""
    path = case / _EVASION
    return load_tracks(path) if header.judgement and path.is_file() else None


def _former_verdict(case: Path, header: Header) -> FormerVerdict:
    """What an older version stored in the judgement of a case."""
    if header.judgement is None:
        return FormerVerdict()
    path = case / HEADER
    return decode(read_bounded(path, JSON_BYTES), _Judged, path).judgement


@dataclass(frozen=True)
class _Judged:
    judgement: FormerVerdict
