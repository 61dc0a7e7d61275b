"""Doors to highway-env: its agents, road networks, vehicles and window."""
