"""Records Scenarios from logged traffic (`regents record --log`)."""

import hashlib
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

from regents_cosim.cases.provenance import sha256_of
from regents_cosim.errors import NoWindowError
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.sources.logs.cut import LogWindows, cut
from regents_cosim.sources.logs.formats import ALONE, CompanionFiles, LogFormat, find_logs, read_log
from regents_cosim.sources.logs.scene import LoggedScene
from regents_cosim.sources.windows import USUAL, RecordingOrigin, Windows

_MANY = 5


def record_log(
    path: Path,
    windows: Windows = USUAL,
    *,
    format: str = "auto",
    ego: str = "auto",
    stride_s: float | None = None,
    beside: CompanionFiles = ALONE,
    tell: Callable[[str], None] = warnings.warn,
) -> list[Scenario]:
    """Up to `windows.count` Scenarios from a log or a folder of logs; the same seed gives the same ones.

    A window begins every `stride_s` (None: back to back), scene by scene in the order of files. `ego` is the id of a
    road user, or "auto" (see `cut`). `tell` gets each assumption that a reader had to make, once. Raises LogError for
    what cannot be read, NoWindowError where there is no window.
    """
    asked = LogWindows(windows, stride_s, ego)
    refused: Counter[str] = Counter()
    logs = find_logs(path, beside.named(format), tell)
    found = list(islice(_each(logs, asked, beside, refused, tell), windows.count))
    if not found:
        raise NoWindowError(_why_none(path, refused, ego))
    return found


def scenes_of(
    path: Path, format: str = "auto", beside: CompanionFiles = ALONE, tell: Callable[[str], None] = warnings.warn
) -> Iterator[tuple[Path, str, LoggedScene]]:
    """File, format and scene of every recording in a log or a folder of logs, one at a time; see `find_logs`."""
    for file, one in find_logs(path, beside.named(format), tell):
        for scene in read_log(file, one, beside):
            yield file, one.name, scene


def origin_of(file: Path, format: str, scene: LoggedScene) -> RecordingOrigin:
    """The origin that the Scenarios of `scene` name in their provenance."""
    return RecordingOrigin(format, file.name, digest_of(file), scene.name)


def _each(
    logs: list[tuple[Path, LogFormat]],
    asked: LogWindows,
    beside: CompanionFiles,
    refused: Counter[str],
    tell: Callable[[str], None],
) -> Iterator[Scenario]:
    names, told = Counter[str](), set[str]()
    for file, one in logs:
        digest = digest_of(file)
        for scene in read_log(file, one, beside):
            names[scene.name] += 1
            name = scene.name if names[scene.name] == 1 else f"{scene.name}-{names[scene.name]}"
            for note in scene.notes:
                if note not in told:
                    told.add(note)
                    tell(f"{file.name}: {note}")
            yield from cut(scene, asked, RecordingOrigin(one.name, file.name, digest, name), refused)


def digest_of(path: Path) -> str:
    """SHA-256 of a file; for a folder, of the names and contents of its files."""
    if path.is_file():
        return sha256_of(path)
    digest = hashlib.sha256()
    for file in sorted(p for p in path.rglob("*") if p.is_file()):
        digest.update(f"{file.relative_to(path)}\0{sha256_of(file)}\n".encode())
    return digest.hexdigest()


def _why_none(path: Path, refused: Counter[str], ego: str) -> str:
    reasons = ", ".join(f"{number} {reason}" for reason, number in refused.most_common(_MANY))
    wanted = "" if ego == "auto" else f" with the ego {ego!r}"
    return (
        f"no window found in {path.name or path}{wanted}: of {refused.total()} candidate egos, "
        f"{reasons or 'none was there'} "
        "(try a shorter `horizon` or `stride`, or name an --ego; `regents inspect` shows what the log holds)"
    )
