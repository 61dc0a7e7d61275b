"""The map of behaviours: which kinds of crash a suite holds, and the best one of each."""
