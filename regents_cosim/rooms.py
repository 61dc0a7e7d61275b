"""Connections between subpackages that do not import each other, given as names and imported on use."""

ADD_PLANNERS = ("regents_cosim.replays",)  # packages that add planners to `planners.bridges`
