"""Logged traffic: one small reader per format, one builder that makes Scenarios of what they read."""
