"""Scenarios go back to the simulators that people work with. A replay knows nothing of attacks or sources."""
