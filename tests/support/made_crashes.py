"""Crashes made by hand, of many kinds and qualities, and a run that finds them without a search."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scenes import DT, TIME, crash, moved, scene

from regents_cosim.runs.window_job import AttackRun
from regents_cosim.scenario.judgement import EDITION, Flaw, Judgement
from regents_cosim.scenario.scenario import Scenario

SPEED = 10.0


def window(number: int) -> Scenario:
    """Two cars one behind the other; the distance of the one ahead differs."""
    return scene((0.0, 0.0, SPEED), (30.0 + number, 0.0, SPEED), name=f"window{number}")


def braked(before: Scenario, name: str, braking: float, closing: float, usual: float, spoilt: bool) -> Scenario:
    """The one ahead stops after two seconds."""
    slow = np.maximum(SPEED - braking * np.maximum(TIME - 2.0, 0.0), 0.0)
    x = before.tracks.x[1, 0] + DT * np.concatenate([[0.0], np.cumsum(slow[:-1])])
    made = crash(before, moved(before, 1, x=x, speed=slow))
    hit = replace(made.collision, relative_speed=closing)
    judged = Judgement((Flaw.EGO_STANDS,) if spoilt else (), usual=usual, edition=EDITION)
    return replace(made, id=name, attack=replace(made.attack, collision=hit), judgement=judged)


@dataclass(frozen=True)
class MadeCrashes(AttackRun):
    """Finds up to two crashes in every window, the same ones whenever it is asked."""

    def attack(self, scenarios: Iterable[Scenario]) -> Iterator[list[Scenario]]:
        """The attacked cases of each scenario."""
        for before in scenarios:
            lot = np.random.default_rng(int(before.id.removeprefix("window")))
            yield [
                braked(
                    before,
                    f"{before.id}-{at}",
                    lot.uniform(5.0, 8.0),
                    lot.uniform(0.0, 24.0),
                    round(lot.uniform(0.0, 100.0), 1),
                    bool(lot.random() < 0.3),
                )
                for at in range(lot.integers(0, 3))
            ]
