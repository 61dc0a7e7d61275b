"""Doors to SUMO: its process, configurations, networks, types and driver models."""
