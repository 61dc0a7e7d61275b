"""Scores of crashes: what they say about the planner, how realistic they are, and how well a method finds them."""
