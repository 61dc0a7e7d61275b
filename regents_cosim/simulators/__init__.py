"""Starts and closes SUMO and highway-env, for sources, planners and replays alike."""
