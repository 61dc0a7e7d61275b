"""A planner for a straight road: keeps its lane, its speed, and its distance to the vehicle ahead."""

from math import sin, sqrt

from regents_cosim import Control

SPEED, HEADWAY, GAP = 20.0, 1.2, 2.5  # [m/s], [s], [m]
ACCEL, BRAKE = 1.5, 3.0  # [m/s^2]


class Planner:
    """A planner that keeps its distance to vehicles whose middle is in its lane."""

    def reset(self, scene):
        """Begin a drive; this planner remembers nothing from step to step."""

    def act(self, observation):
        """Choose the highest acceleration that keeps the distance to all vehicles ahead."""
        ego = observation.ego
        ahead = [other for other in observation.others if self.in_my_way(other, ego)]
        return Control(accel=min([follow(ego, other) for other in ahead], default=speed_up(ego)), curvature=0.0)

    def in_my_way(self, other, ego):
        """Whether another vehicle is ahead, in the same lane."""
        ahead, left = other.seen_from(ego)
        return ahead > 0.0 and abs(left) < 1.0


class Fixed(Planner):
    """A planner that looks at whole cars, and a second and a half ahead."""

    def in_my_way(self, other, ego):
        """Whether any part of another vehicle is in the lane, or will be soon."""
        ahead, left = other.seen_from(ego)
        soon = left + 1.5 * other.speed * sin(other.yaw - ego.yaw)
        reach = 0.5 * (ego.width + other.width) + 0.3
        return ahead > 0.0 and (min(abs(left), abs(soon)) < reach or left * soon < 0.0)


def speed_up(ego):
    """The Intelligent Driver Model on a free road [m/s^2]."""
    return ACCEL * (1.0 - (ego.speed / SPEED) ** 4)


def follow(ego, other):
    """The Intelligent Driver Model behind `other` [m/s^2]."""
    gap = max(other.seen_from(ego)[0] - 0.5 * (ego.length + other.length), 0.1)
    closing = ego.speed - other.speed
    wanted = GAP + max(0.0, HEADWAY * ego.speed + ego.speed * closing / (2.0 * sqrt(ACCEL * BRAKE)))
    return max(speed_up(ego) - ACCEL * (wanted / gap) ** 2, -6.0)
