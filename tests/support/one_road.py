"""A host of live attacks with one vehicle, which goes where it is placed."""


class OneRoad:
    """Takes every vehicle, and keeps nothing of what it is told."""

    def __init__(self, step_s=0.1):
        self.step_s = step_s

    def take(self, name, length_m):
        return self

    def follow_route_of(self, plan):
        pass

    def confirm(self):
        pass

    def place(self, x, y, yaw, speed):
        pass

    def is_at_ease(self):
        return False

    def give_back(self):
        return True

    def is_spared(self, name):
        return False
