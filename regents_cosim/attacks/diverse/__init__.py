"""Searches that go on after the first crash, for others that differ from it."""
