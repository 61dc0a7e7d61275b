"""Paths for the tests: the repository, its networks, and recordings and cities beside it."""

import os
import shutil
from pathlib import Path

SUPPORT = Path(__file__).parent
ROOT = SUPPORT.parents[1]
NETS = ROOT / "sumo_nets"
DATA = Path(os.environ.get("REGENTS_DATA", ROOT.parent / "shared" / "data"))


def own_copy(config: Path, folder: Path) -> Path:
    """A configuration in a copy of its folder, where SUMO may write the outputs that it asks for."""
    copied = shutil.copytree(config.parent, folder / "copy", copy_function=shutil.copyfile)
    copied.chmod(0o755)  # the original may be read-only
    return copied / config.name
