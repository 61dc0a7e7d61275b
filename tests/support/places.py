"""Where the tests find what is not theirs: the repository and the programs and planners beside this file."""

from pathlib import Path

SUPPORT = Path(__file__).parent
ROOT = SUPPORT.parents[1]
