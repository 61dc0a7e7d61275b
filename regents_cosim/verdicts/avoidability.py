"""Could the ego have avoided the crash? A bank of manoeuvres, tried against the fixed tracks of all others.

Sound: a collision counts as avoidable only with a track of the ego that comes no one nearer than
0.1 m up to the end of the horizon, by the exact boxes, and keeps to the road. To be late is not
to evade: for 2 s beyond the horizon the one that was hit goes straight on, and the manoeuvre must
clear it there too. Not complete: where the whole bank fails, another manoeuvre might have worked.

Fixed means that no one makes way: the adversary and all others drive as in the attacked
case. A follower who does not brake for a braking ego spoils that manoeuvre, though a real one
would have braked; that makes the verdict strict. And an adversary that was sent to where the ego
would be is not sent again; that makes it lenient towards egos that do anything else early.
`last_onset_step` tells the early escapes from the late ones.
"""

from dataclasses import replace

import numpy as np

from regents_cosim.errors import ScenarioError
from regents_cosim.scenario import Avoidability, Scenario, Tracks
from regents_cosim.verdicts.manoeuvres import BANK, Bank, Fan, fans
from regents_cosim.verdicts.obstacles import Others, Road
from regents_cosim.verdicts.perception import perceived_step, reacts_step
from regents_cosim.verdicts.preference import FOR_GOOD_S, Preference

_MARGIN_M = 0.1  # on every side of the ego: simulators that place it elsewhere by millimetres agree


def avoidability(attacked: Scenario, bank: Bank = BANK) -> tuple[Avoidability, Tracks | None]:
    """Whether a manoeuvre that begins before the collision avoids it, and the one that a careful driver would do.

    That one is the first by `preference`, and comes with its track [1, time]. Raises ScenarioError where there is no
    collision.
    """
    hit = attacked.attack.collision if attacked.attack else None
    if hit is None:
        raise ScenarioError(f"case {attacked.id} holds no collision, expected one that the ego may avoid")
    perceived = perceived_step(attacked, [agent.id for agent in attacked.agents].index(hit.agent))
    reacts = reacts_step(perceived, attacked.dt)
    others, road = Others(attacked, hit, _MARGIN_M), Road(attacked)
    steps = attacked.tracks.steps + round(FOR_GOOD_S / attacked.dt)
    tried, evading = 0, list[Fan]()
    for fan in fans(bank, attacked, hit.step, steps, also=(perceived, reacts)):
        tried += len(fan)
        left = road.keeping_to_it(others.untouched_by(fan))
        evading += [left] if len(left) else []
    if not evading:
        return Avoidability(False, tried, 0, None, None, False, perceived), None
    preference = Preference(attacked, hit, bank, perceived, reacts)
    fan, index = preference.first(evading)
    one = fan.take(np.array([index]))
    verdict = Avoidability(
        avoidable=True,
        tried=tried,
        evading=sum(map(len, evading)),
        last_onset_step=evading[0].onset,
        gentlest=replace(
            one.manoeuvre(0, bank), side=preference.side(one)[0], runs_red=bool(preference.runs_red(one)[0])
        ),
        in_time=bool(fan.onset >= reacts and preference.answers(one)[0]),
        perceived_step=perceived,
    )
    return verdict, one.tracks(0, attacked)
