"""Did a planner get worse than what was accepted."""
