"""Turns the traffic of simulators and logs into Scenarios. A source knows nothing of attacks."""
