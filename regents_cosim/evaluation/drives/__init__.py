"""How well a planner drove: its collisions, its progress, and how close it came."""
