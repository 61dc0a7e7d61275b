"""What a run attacks: traffic that windows are recorded from, or cases on disk."""

import hashlib
import json
import logging
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from regents_cosim.cases.provenance import sha256_of
from regents_cosim.errors import require_file
from regents_cosim.runs.planner_files import planner_digest
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.simulators.sumo.config import SumoInput, read_input
from regents_cosim.sources.conflicts import Possible, possible_conflict
from regents_cosim.sources.logs.record import digest_of
from regents_cosim.sources.record import LogInput, record, traffic_input
from regents_cosim.sources.windows import EgoKind, Prefer
from regents_cosim.system.progress import SILENT, Progress

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Traffic:
    """Traffic, and the windows that are wanted of it; the fields are the arguments of `regents_cosim.record`."""

    source: SumoInput | LogInput | str  # a string: `highway:` and an environment of highway-env, or a path
    count: int = 8
    seed: int = 0
    horizon_s: float = 8.0
    radius_m: float = 100.0
    prefer: Prefer = "conflicts"
    max_agents: int = 64
    ego_kind: EgoKind = "auto"
    fcd: Path | None = None
    policy: str = "idm"

    def __post_init__(self) -> None:
        """A path becomes the input that it refers to, whose files decide whether a run may go on."""
        object.__setattr__(self, "source", traffic_input(self.source))

    def record(self, pool: Executor | None = None, progress: Progress = SILENT) -> list[Scenario]:
        """Record the windows; `pool` runs SUMO, by default processes of our own. Raises RegentsError."""
        found = record(**vars(self), executor=pool, tell=progress.say, progress=progress)
        _log.info("recorded %d windows", len(found))
        if len(found) < self.count and not isinstance(self.source, LogInput):
            progress.say(f"found {len(found)} of the {self.count} windows asked for: the traffic holds no more")
        if any(scenario.road.connections for scenario in found):
            others = "pedestrians" if self.prefer == "pedestrians" else "all"
            possible = [possible_conflict(one, others) for one in found]
            number, first = sum(map(bool, possible)) or "none", possible.count(Possible.WITH_RIGHT_OF_WAY) or "none"
            who = "a pedestrian" if others == "pedestrians" else "another road user"
            progress.say(
                f"windows in which {who} can lawfully cross or join the ego's path: {number} of {len(found)}; in "
                f"{first} of them with the right of way"
            )
        return found

    def digest(self) -> str:
        """SHA-256 of the files that the windows are recorded from. Raises RegentsError."""
        return traffic_digest(self.source, self.fcd, self.policy)

    def settings(self) -> dict[str, Any]:
        """What decides which windows there are, by the names of the command line's options."""
        wanted = {"count": self.count, "seed": self.seed, "horizon": self.horizon_s, "radius": self.radius_m}
        wanted |= {"prefer": self.prefer, "max_agents": self.max_agents, "ego_kind": self.ego_kind}
        return wanted | {"fcd": self.fcd, "policy": self.policy} | _named(self.source)


@dataclass(frozen=True)
class SavedCases:
    """A case or a suite on disk, also `shipped:standard`; its cases are the windows."""

    path: Path | str
    seed: int = 0  # noted in the suite that a run makes of them

    def settings(self) -> dict[str, Any]:
        """What decides which windows there are, besides the hashes of the cases."""
        return {"seed": self.seed}


def _named(source: SumoInput | LogInput | str) -> dict[str, Any]:
    sumo = source if isinstance(source, SumoInput) else SumoInput()
    log = source if isinstance(source, LogInput) else LogInput(Path())
    return {
        "source": source if isinstance(source, str) else "",
        "ego": "auto" if isinstance(source, str) else source.ego,
        "config": sumo.config,
        "net": sumo.net,
        "routes": ",".join(map(str, sumo.routes)),
        "additional": ",".join(map(str, sumo.additional)),
        "begin": sumo.begin_s,
        "end": sumo.end_s,
        "sumo_options": list(sumo.extra),
        "log": log.path if log is source else None,
        "format": log.format,
        "stride": log.stride_s,
        "map": log.map,
        "columns": log.columns,
    }


def traffic_digest(source: SumoInput | LogInput | str, fcd: Path | None = None, policy: str = "") -> str:
    """SHA-256 of all files behind the traffic. Raises RegentsError where one is missing."""
    if isinstance(source, str):
        said = [planner_digest(f"highway:{policy}") + planner_digest(source)]
    elif isinstance(source, LogInput):
        said = [digest_of(path) for path in (source.path, source.map, source.columns) if path is not None]
    else:
        said = _sumo(source, fcd)
    return hashlib.sha256(json.dumps(said).encode()).hexdigest()


def _sumo(source: SumoInput, fcd: Path | None) -> list[str]:
    options = read_input(source)
    named = [path for paths in options.read.values() for path in paths if path.is_file()]
    files = [options.file, options.net, *options.files, *named, *([fcd] if fcd else [])]
    for file in files:
        require_file(file, "file of the traffic")
    return [*map(sha256_of, files), json.dumps([options.others, options.typed], sort_keys=True)]
