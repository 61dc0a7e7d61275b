"""Readers of logs, one a format."""
