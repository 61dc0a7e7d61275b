"""Replays cases in SUMO: vehicles on their tracks or driven by SUMO; the ego optionally driven by SUMO's models."""
