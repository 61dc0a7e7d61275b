"""Detects whether a planner got worse than what was accepted."""
