"""Writes cases in the formats of other tools."""
