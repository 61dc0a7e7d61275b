"""Verdicts on a crash: whether it is clean and lawful, whose fault it is, and whether a careful driver avoids it."""
