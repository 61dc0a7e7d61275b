"""Runs of a table kept on disk as soon as they are made: a table that was interrupted goes on, or grows by places.

Each run is a folder of cases beside `run.json`, which is written last. Its name says what was run: the method with its
settings, the planner with its files, the windows and the versions of the packages, ours included, so that a run of
something else is never taken for it.
"""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import msgspec

from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.campaign.identity import identity
from regents_cosim.campaign.planner_files import planner_digest
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case, save_case
from regents_cosim.checks.names import file_name, word
from regents_cosim.errors import CaseError
from regents_cosim.evaluation.crashes.scores import CrashInSumo, MethodRun
from regents_cosim.scenario import Scenario
from regents_cosim.system.atomic import explain_write, write_atomic

_HEADER = "run.json"
_NAME = 60  # letters of a method and a planner in a folder's name


class _Header(msgspec.Struct, frozen=True):
    """What the cases do not say."""

    method: str
    planner: str
    rollouts: int
    seconds: float
    protocol: dict[str, str | int]
    windows: list[list[str]]  # ids of the results of each
    in_sumo: list[CrashInSumo]


def run_folder(
    folder: Path, method: str, planner: str, config: AttackConfig | None, windows: Sequence[Scenario]
) -> Path:
    """Where the run of a method on these windows belongs."""
    settings = {"method": method, "planner": planner, "config": asdict(config) if config else None}
    run = identity("bench table1", settings, {planner: planner_digest(planner)})
    digest = run.key(*(content_hash(window) for window in windows))
    return folder / "runs" / file_name(word(method, _NAME), word(planner, _NAME), digest)


def keep(run: MethodRun, folder: Path) -> None:
    """Write a run. Raises RegentsError where that is not possible."""
    header = _Header(
        run.method,
        run.planner,
        run.rollouts,
        run.seconds,
        _plain(run.protocol),
        [[case.id for case in results] for results in run.windows],
        list(run.in_sumo),
    )
    with explain_write(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for results in run.windows:
            for case in results:
                save_case(case, folder)
        write_atomic(folder / _HEADER, msgspec.json.encode(header))


def kept(folder: Path) -> MethodRun | None:
    """The run that a folder keeps; None where it was never finished. Raises CaseError for damaged ones."""
    path = folder / _HEADER
    if not path.is_file():
        return None
    try:
        header = msgspec.json.decode(path.read_bytes(), type=_Header)
    except (OSError, msgspec.MsgspecError) as error:
        raise CaseError(f"{path}: {error} (remove the folder to make the run again)") from error
    windows = [[load_case(folder / name) for name in names] for names in header.windows]
    protocol = tuple(header.protocol.items())
    return MethodRun(header.method, header.planner, header.rollouts, windows, header.in_sumo, header.seconds, protocol)


def _plain(protocol: Sequence[tuple[str, object]]) -> dict[str, str | int]:
    return {name: value if isinstance(value, int) else str(value) for name, value in protocol}


def joined(runs: Sequence[MethodRun]) -> MethodRun:
    """The runs of one method on several places as one."""
    first = runs[0]
    return MethodRun(
        first.method,
        first.planner,
        first.rollouts,
        [results for run in runs for results in run.windows],
        [one for run in runs for one in run.in_sumo],
        sum(run.seconds for run in runs),
        first.protocol,
    )
