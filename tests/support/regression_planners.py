"""A planner of every fate, one case each: it raises, it hangs, it drives."""

import time

from regents_cosim import Control


class Moody:
    def reset(self, scene):
        self.case = scene.id

    def act(self, observation):
        if self.case == "pushes":
            raise KeyError("lost")
        if self.case == "squeezes_in" and observation.step == 3:
            time.sleep(1000)
        return Control(accel=0.0, curvature=0.0)
