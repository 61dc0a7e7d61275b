"""Searches that continue after the first crash, to find crashes that differ from it."""
