"""Paths for the tests: the repository, its networks, and recordings and cities beside it."""

import os
from pathlib import Path

SUPPORT = Path(__file__).parent
ROOT = SUPPORT.parents[1]
NETS = ROOT / "sumo_nets"
DATA = Path(os.environ.get("REGENTS_DATA", ROOT.parent / "shared" / "data"))
