"""Suites of cases: chosen, built, checked, and planners ranked on them."""
