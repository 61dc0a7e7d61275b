"""Starts and closes SUMO and highway-env, for sources, planners and replays alike."""

STEP_S = 0.1  # of every recording
ANY_EGO = "auto"
COLOURS = {"ego": (0, 114, 178), "adversary": (213, 94, 0), "background": (150, 150, 150)}  # by role
