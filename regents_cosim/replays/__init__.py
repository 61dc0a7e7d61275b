"""Replays Scenarios in the simulators that people use. A replay knows nothing of attacks or sources."""
