"""Paths for the tests: the repository, and the programs and planners beside this file."""

from pathlib import Path

SUPPORT = Path(__file__).parent
ROOT = SUPPORT.parents[1]
