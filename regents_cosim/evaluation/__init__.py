"""Scores of planners, attacks and suites, with their uncertainty."""
