"""Planners: the systems under test."""
