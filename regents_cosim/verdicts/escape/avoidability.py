"""Decide whether the ego could have avoided a crash, with a bank of manoeuvres among the fixed tracks of all others.

The verdict is sound: a collision counts as avoidable only with a track of the ego that stays 0.1 m away from all others
up to the end of the horizon, by the exact boxes, and keeps to the road. Merely being late is no evasion: for 2 s beyond
the horizon the colliding agent goes straight on, and the manoeuvre must clear it there too. The verdict is not
complete: where the whole bank fails, another manoeuvre might have worked.

All others drive as in the attacked case, and nobody makes way. A follower that does not brake for a braking ego spoils
a manoeuvre, though a real one would have braked; that makes the verdict strict. An adversary that was steered to the
ego's place does not follow an ego that does something else early; that makes it lenient. `last_onset_step` tells early
escapes from late ones.
"""

from dataclasses import dataclass, replace

import numpy as np

from regents_cosim.errors import ScenarioError
from regents_cosim.judgement import Avoidability, Manoeuvre
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.verdicts.careful.perception import perceived_step, reacts_step
from regents_cosim.verdicts.escape.manoeuvres import BANK, ManoeuvreBank, ManoeuvreSet, manoeuvre_sets
from regents_cosim.verdicts.escape.obstacles import DrivableRoad, Obstacles
from regents_cosim.verdicts.escape.preference import FOR_GOOD_S, Preference

MARGIN_M = 0.1  # on every side of the ego, so that simulators that place it a few millimetres off agree


def avoidability(attacked: Scenario, bank: ManoeuvreBank = BANK) -> tuple[Avoidability, Tracks | None]:
    """Whether a manoeuvre that begins before the collision avoids it, with the track [1, time] of the preferred one.

    `preference` chooses the preferred manoeuvre. Raises ScenarioError where there is no collision.
    """
    tried = TriedManoeuvres.of(attacked, bank)
    return tried.preferred() if tried.evading else (tried.verdict, None)


@dataclass(frozen=True, eq=False)
class TriedManoeuvres:
    """The manoeuvres of a bank that avoid a crash, and how many were tried."""

    preference: Preference
    attacked: Scenario
    bank: ManoeuvreBank
    count: int
    evading: list[ManoeuvreSet]  # by onset, the last first; no set is empty

    @classmethod
    def of(cls, attacked: Scenario, bank: ManoeuvreBank = BANK) -> "TriedManoeuvres":
        """Try all manoeuvres of a bank. Raises ScenarioError where there is no collision."""
        hit = attacked.attack.collision if attacked.attack else None
        if hit is None:
            raise ScenarioError(f"case {attacked.id} holds no collision, expected one that the ego may avoid")
        perceived = perceived_step(attacked, [agent.id for agent in attacked.agents].index(hit.agent))
        reacts = reacts_step(perceived, attacked.dt)
        others, road = Obstacles(attacked, hit, MARGIN_M), DrivableRoad(attacked)
        steps = attacked.tracks.steps + round(FOR_GOOD_S / attacked.dt)
        count, evading = 0, list[ManoeuvreSet]()
        for manoeuvres in manoeuvre_sets(bank, attacked, hit.step, steps, also=(perceived, reacts)):
            count += len(manoeuvres)
            left = road.keeping_to_it(others.untouched_by(manoeuvres))
            evading += [left] if len(left) else []
        return cls(Preference(attacked, hit, bank, perceived, reacts), attacked, bank, count, evading)

    @property
    def verdict(self) -> Avoidability:
        """The verdict without a preferred manoeuvre."""
        return Avoidability(
            avoidable=bool(self.evading),
            tried=self.count,
            evading=sum(map(len, self.evading)),
            last_onset_step=self.evading[0].onset if self.evading else None,
            gentlest=None,
            in_time=False,
            perceived_step=self.preference.perceived,
        )

    def preferred(self) -> tuple[Avoidability, Tracks]:
        """The verdict with the manoeuvre that a careful driver would choose, and its track [1, time]."""
        manoeuvres, index = self.preference.first(self.evading)
        one = manoeuvres.take(np.array([index]))
        in_time = manoeuvres.onset >= self.preference.reacts and self.preference.answers(one)[0]
        gentlest = self.placed(one, one.manoeuvre(0, self.bank))
        return replace(self.verdict, gentlest=gentlest, in_time=bool(in_time)), one.tracks(0, self.attacked)

    def placed(self, one: ManoeuvreSet, manoeuvre: Manoeuvre) -> Manoeuvre:
        """The manoeuvre with the side of the road to which it leads, and whether it passes a red light."""
        red = bool(self.preference.runs_red(one)[0])
        return replace(manoeuvre, side=self.preference.side(one)[0], runs_red=red)
