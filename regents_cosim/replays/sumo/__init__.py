"""Cases in SUMO again: placed step by step, or left to its drivers; the ego by its own models."""
