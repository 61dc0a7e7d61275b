"""Scores of a planner's drives: collisions, progress, and closeness to collisions."""
