"""Weights on disk as safetensors, which hold numbers and nothing that could run."""

from pathlib import Path

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from regents_cosim.errors import RegentsError, require_file
from regents_cosim.planners.aim_bev.architecture import FEATURES, KNOWN, MLP
from regents_cosim.system.files.output_files import MARK, write_output_file

_FOLDER = Path(__file__).parent / "weights"
SHIPPED = _FOLDER / "aim_bev.safetensors"
HARDENED = _FOLDER / "aim_bev_hardened.safetensors"  # trained further on crashes and on lights: MODEL_CARD.md
_UNTOLD = (MLP[0], FEATURES + KNOWN - 1)  # first layer of the head without the light's input, and Adam's moments of it
BY_PLANNER = {"aim-bev": SHIPPED, "aim-bev-hardened": HARDENED}


def load_weights(path: Path) -> dict[str, np.ndarray]:
    """Arrays by name. Raises RegentsError where the file is missing or not safetensors.

    Weights without an input for closed lights get zeros for it.
    """
    try:
        found = load(require_file(path, "weights").read_bytes())
    except SafetensorError as error:
        raise RegentsError(f"{path} cannot be read as safetensors: {error}") from error
    return {name: np.pad(v, ((0, 0), (0, 1))) if v.shape == _UNTOLD else v for name, v in found.items()}


def save_weights(weights: dict[str, np.ndarray], path: Path) -> None:
    """Write arrays atomically; only weights that were written by this package are overwritten."""
    plain = {name: np.ascontiguousarray(values) for name, values in weights.items()}
    write_output_file(path, save(plain, metadata={"generator": MARK}))
