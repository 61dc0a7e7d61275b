"""The doors to SUMO and highway-env, for sources, planners and replays alike."""
