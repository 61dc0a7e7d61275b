"""The search for adversary controls. Knows nothing of SUMO."""
