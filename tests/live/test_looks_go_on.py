"""When an attacker looks for a plan: every fifth of a second, and at once where a look goes on with the one before."""

import numpy as np

from regents_cosim.live.attacker import Attacker, Tally
from regents_cosim.live.frame import Frame
from regents_cosim.sources.sumo_types import VehicleType

CAR = VehicleType("car", 5.0, 1.8)


class Looks:
    """Finds nothing, and notes when it is asked; from the look at `begins_s` on `more` looks go on."""

    def __init__(self, begins_s=np.inf, more=0):
        self.looked_s, self.prepared_s, self._begins_s, self._more = [], [], begins_s, more

    @property
    def goes_on(self):
        return bool(self.looked_s) and self._more > 0 and self.looked_s[-1] >= self._begins_s

    def prepare(self, frame):
        self.prepared_s.append(round(frame.time_s, 2))

    def fresh(self, frame, barred):
        self._more -= self.goes_on
        self.looked_s.append(round(frame.time_s, 2))


class OneRoad:
    step_s = 0.1


def watch(plans, steps=9):
    flat = np.zeros(2)
    attacker = Attacker(OneRoad(), plans, 0.5, Tally(), lambda *_: None)
    for step in range(steps):
        frame = Frame(0.1 * step, ("ego", "other"), flat, flat + 50.0, flat, flat + 10.0, flat, (CAR, CAR), {})
        attacker.step(frame, lambda: True)
    return plans


def test_a_look_comes_every_fifth_of_a_second_and_is_prepared_in_between():
    seen = watch(Looks())
    assert seen.looked_s == [0.0, 0.2, 0.4, 0.6, 0.8]
    assert seen.prepared_s == [0.1, 0.3, 0.5, 0.7]


def test_a_look_that_goes_on_comes_at_the_next_step():
    seen = watch(Looks(begins_s=0.2, more=3))
    assert seen.looked_s == [0.0, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8]
    assert seen.prepared_s == [0.1, 0.7]
