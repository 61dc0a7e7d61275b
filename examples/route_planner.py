"""A planner that follows `Scene.route`: its lanes, limits and lights, by the Intelligent Driver Model.

Try it with `regents evaluate shipped:standard --planner route_planner.py:Planner`.
"""

from math import sqrt

import numpy as np

from regents_cosim import Control

HEADWAY, GAP, ACCEL, BRAKE = 1.0, 2.0, 2.0, 3.0  # [s], [m], [m/s^2], [m/s^2]
SIDEWAYS = 2.5  # [m/s^2] in bends


class Planner:
    """Keeps to the limit and slows for bends, follows its leader, and stops at red lights."""

    def reset(self, scene):
        """The lanes change where the first observation shows a gap."""
        self.route, self.planned = scene.route, False

    def act(self, observation):
        """The gentlest that all allow."""
        ego = observation.ego
        if not self.planned:
            self.route, self.planned = scene_gaps(observation), True
        along = float(self.route.project(ego.x, ego.y).along)
        front = along + 0.5 * ego.length
        ahead = self.route.ahead(along, 2.0 * ego.speed + 10.0)
        bends = np.minimum(ahead.speed_limit, np.sqrt(SIDEWAYS / np.maximum(np.abs(ahead.curvature), 1e-3)))
        pace = float(np.sqrt(bends**2 + 2.0 * ACCEL * np.maximum(ahead.along - along, 0.0)).min())
        stops = [light.gap for light in observation.lights_ahead if light.shows in "ryu"]
        gaps = [(gap, 0.0) for gap in stops if ego.speed**2 < 9.0 * gap]  # those before which it can stop
        found = self.route.next_ahead(front, ego.width, observation.others)
        if found is not None:
            gaps.append((found[1], float(observation.others.speed[found[0]])))
        accel = min([follow(ego.speed, pace, *one) for one in gaps], default=free(ego.speed, pace))
        return Control(max(accel, -6.0), self.route.pure_pursuit(ego.x, ego.y, ego.yaw, ego.speed))


def scene_gaps(observation):
    """The route with lane changes into the gaps between those that are there."""
    ego = observation.ego
    return observation.scene.route.into_gaps(ego.length, ego.width, observation.others)


def free(speed, pace):
    """The acceleration of a free road [m/s^2]."""
    return ACCEL * (1.0 - (speed / max(pace, 0.1)) ** 4)


def follow(speed, pace, gap, other):
    """The acceleration at a gap [m] to something that moves at `other` [m/s]."""
    wanted = GAP + max(0.0, HEADWAY * speed + speed * (speed - other) / (2.0 * sqrt(ACCEL * BRAKE)))
    return free(speed, pace) - ACCEL * (wanted / max(gap, 0.1)) ** 2
