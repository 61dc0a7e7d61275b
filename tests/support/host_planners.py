"""Planners outside JAX, good ones and bad ones, as a user would write them."""

import os
import sys
import time

import numpy as np

from regents_cosim import Control, Waypoints


class Cautious:
    """Brakes for whoever is close ahead in its lane."""

    def reset(self, scene):
        self.asked = 0

    def act(self, observation):
        assert observation.step == self.asked  # a drive goes from the first step on, and skips none
        self.asked += 1
        seen = [other.seen_from(observation.ego) for other in observation.others]
        near = any(0.0 < ahead < 15.0 and abs(left) < 2.0 for ahead, left in seen)
        return Control(accel=-4.0 if near else 1.0, curvature=0.0)


class InBatches(Cautious):
    """A planner for many scenes at once, which refuses single ones."""

    def act(self, observation):
        raise RuntimeError("one by one")

    def reset_batch(self, scenes):
        self.drivers = [Cautious() for _ in scenes]
        for driver, scene in zip(self.drivers, scenes, strict=True):
            driver.reset(scene)

    def act_batch(self, observations):
        return [driver.act(seen) for driver, seen in zip(self.drivers, observations, strict=True)]


class Circles(Cautious):
    """Waypoints on a circle of 40 m to the left, 0.5 s apart at 8 m/s."""

    def act(self, observation):
        ego = observation.ego
        turned = 8.0 * 0.5 * np.arange(1, 5) / 40.0
        ahead, left = 40.0 * np.sin(turned), 40.0 * (1.0 - np.cos(turned))
        cos, sin = np.cos(ego.yaw), np.sin(ego.yaw)
        return Waypoints(np.stack([ego.x + ahead * cos - left * sin, ego.y + ahead * sin + left * cos], axis=1))


class Witness(Cautious):
    """Says what it saw by raising it."""

    def act(self, observation):
        if observation.step < 3:
            return Control(0.0, 0.0)
        near = {lane.id for lane in observation.lanes_within(4.0)}
        others = {other.id: round(other.x, 1) for other in observation.others}
        raise RuntimeError(
            f"{observation.time_s:.1f} {observation.ego.id} {others} {sorted(near)} {observation.target}"
        )


class FailsLate(Cautious):
    """Drives well, then not."""

    def act(self, observation):
        return self.fail() if observation.step == 5 else super().act(observation)


class Raises(FailsLate):
    def fail(self):
        raise KeyError("lost")


class Sleeps(FailsLate):
    def fail(self):
        time.sleep(1000)


class Exits(FailsLate):
    def fail(self):
        os._exit(3)


class Quits(FailsLate):
    def fail(self):
        sys.exit(4)


class NotANumber(FailsLate):
    def fail(self):
        return Control(float("nan"), 0.0)


class Vectors(FailsLate):
    def fail(self):
        return Control(np.zeros(3), 0.0)


class Beyond(FailsLate):
    def fail(self):
        return Control(-12.0, 0.0)


class Mute(FailsLate):
    def fail(self):
        return None


class Scattered(FailsLate):
    def fail(self):
        return Waypoints(np.zeros((4, 3)))


class Unpaced(FailsLate):
    def fail(self):
        return Waypoints(np.zeros((4, 2)), float("inf"))


class AllAtOnce(InBatches):
    def act_batch(self, observations):
        return None


class NeverMade(Cautious):
    def __init__(self):
        raise OSError("no weights")


class FailsInOneScene(Cautious):
    def reset(self, scene):
        super().reset(scene)
        if scene.id == "bad":
            raise KeyError("lost")


class FailsInOneSceneInBatches(InBatches):
    def reset_batch(self, scenes):
        super().reset_batch(scenes)
        if any(scene.id == "bad" for scene in scenes):
            raise KeyError("lost")
