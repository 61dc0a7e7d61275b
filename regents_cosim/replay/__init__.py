"""Scenarios back into simulators, and what became of the crash there."""
