"""Starts and closes SUMO and highway-env, for sources, planners and replays alike."""

STEP_S = 0.1  # of every recording
ANY_EGO = "auto"
