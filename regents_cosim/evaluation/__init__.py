"""Scores: what was measured, with how much certainty."""
