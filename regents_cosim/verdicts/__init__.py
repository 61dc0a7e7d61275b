"""Verdicts on a crash: whether it is clean, lawful and avoidable, and whose fault it is."""
