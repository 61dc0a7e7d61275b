"""Builds, checks and merges suites of cases, and ranks planners on them."""
