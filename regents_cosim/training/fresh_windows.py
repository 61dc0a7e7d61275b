"""Records windows of traffic for every round of training and for judging it; no seed is used twice."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from regents_cosim.cases.provenance import sha256_of
from regents_cosim.cases.shipped import network
from regents_cosim.errors import RegentsError, require
from regents_cosim.runs.steps import Steps
from regents_cosim.runs.traffic import traffic_digest
from regents_cosim.runs.window_job import AttackRun
from regents_cosim.scenario import Scenario
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.sources.record import record
from regents_cosim.system.progress import Progress


@dataclass(frozen=True)
class FreshWindows:
    """Windows that are recorded when they are needed, and kept as steps of the run (`runs.steps`)."""

    nets: tuple[str, ...]  # shipped SUMO networks, or .sumocfg files
    first_seed: int  # seed of round 1; each round takes the next one
    horizon_s: float
    steps: Steps
    progress: Progress

    def __post_init__(self) -> None:
        """Raise RegentsError for two networks of one name, whose windows would have one name too."""
        names = [path.name for path in self._configs]
        require(
            len(set(names)) == len(names) > 0,
            f"networks {', '.join(names) or 'none'}: expected at least one, each under a name of its own",
            RegentsError,
        )

    def seed(self, round_number: int) -> int:
        """SUMO's seed for the windows of a round."""
        return self.first_seed + round_number - 1

    def digests(self) -> list[str]:
        """The digests of the files of each network. Raises RegentsError for a missing file."""
        return [traffic_digest(SumoInput(config=path)) for path in self._configs]

    def require_unseen(self, cases: Iterable[Scenario], rounds: int) -> None:
        """Raise RegentsError for a case of traffic that one of the `rounds` records too."""
        configs = {sha256_of(path) for path in self._configs}
        seeds = {self.seed(number + 1) for number in range(rounds)}
        for case in cases:
            made = case.provenance
            require(
                made.sha256 not in configs or made.seed not in seeds,
                f"{case.id} is of {made.file} with seed {made.seed}; seeds {min(seeds)} to {max(seeds)} are those of "
                "fresh windows: expected cases of other seeds (or another `first_seed`)",
                RegentsError,
            )

    def attacked(self, round_number: int, name: str, count: int, run: AttackRun) -> list[list[Scenario]]:
        """The results of an attack on each window of a round; `name` tells it from other attacks there."""
        found = []
        for path, windows in self._recorded(round_number, count):
            place, what = f"{name} of round {round_number} on {path.stem}", f"attacking {run.planner} on {path.stem}"
            found += self.steps.attacked(
                place, windows, run, lambda done, of, what=what: self.progress.each(done, what, of)
            )
        return found

    def windows(self, round_number: int, count: int) -> list[Scenario]:
        """The windows of a round, the same number of each network."""
        return [window for _, windows in self._recorded(round_number, count) for window in windows]

    def _recorded(self, round_number: int, count: int) -> Iterator[tuple[Path, list[Scenario]]]:
        for path in self._configs:
            settings = {"seed": self.seed(round_number), "windows": count, "horizon": self.horizon_s}
            recorded = partial(
                record, path, count=count, seed=settings["seed"], horizon_s=self.horizon_s,
                tell=self.progress.say, progress=self.progress,
            )  # fmt: skip
            digest = traffic_digest(SumoInput(config=path))
            place = f"windows of round {round_number} on {path.stem}"
            yield path, self.steps.recorded(place, settings, digest, recorded)

    @property
    def _configs(self) -> list[Path]:
        return [network(name) for name in self.nets]
