"""The architecture of the network, shared by torch (which trains it) and JAX (which runs it).

It is MobileNetV3-small (Howard et al. 2019, table 2), with parameters named as in torchvision, and the head of AIM-BEV
(KING, Hanselmann et al. 2022). Besides the picture the head gets the ego's speed, which one picture cannot show, and
how near the next closed light on its way is. KING's agent also gets a flag for a light.
"""

from typing import NamedTuple


class Block(NamedTuple):
    """Shape of one inverted residual block."""

    kernel: int
    inputs: int
    expanded: int
    outputs: int
    squeeze: bool  # squeeze and excitation
    hard_swish: bool  # otherwise ReLU
    stride: int


STEM = 16  # channels after the first convolution, 3 x 3, stride 2, hard-swish
BLOCKS = (
    Block(3, 16, 16, 16, True, False, 2),
    Block(3, 16, 72, 24, False, False, 2),
    Block(3, 24, 88, 24, False, False, 1),
    Block(5, 24, 96, 40, True, True, 2),
    Block(5, 40, 240, 40, True, True, 1),
    Block(5, 40, 240, 40, True, True, 1),
    Block(5, 40, 120, 48, True, True, 1),
    Block(5, 48, 144, 48, True, True, 1),
    Block(5, 48, 288, 96, True, True, 2),
    Block(5, 96, 576, 96, True, True, 1),
    Block(5, 96, 576, 96, True, True, 1),
)
LAST = 576  # channels of the last convolution, 1 x 1, hard-swish
FEATURES = 512
MLP = (256, 128, 64)
HIDDEN = 64
WAYPOINTS = 8
WAYPOINT_S = 0.1  # between two waypoints
NORM_EPSILON = 1e-3
COORDINATE_M = 10.0  # unit of coordinates inside the network
SPEED_M_S = 10.0  # unit of speeds inside the network
FAR_TARGET_M = 40.0  # beyond this only the direction of a target counts
NEARNESS = 10.0  # factor of a light's nearness inside the network: Adam hardly learnt to use a smaller number
KNOWN = 2  # inputs of the head besides the features: speed, and nearness of a closed light

LEAST_VIEW_M, MOST_VIEW_M = 10.0, 100.0


def squeezed(expanded: int) -> int:
    """The number of channels inside squeeze and excitation: a quarter, rounded to a multiple of 8 within a tenth."""
    channels = max(8, (expanded // 4 + 4) // 8 * 8)
    return channels + 8 if channels < 0.9 * (expanded // 4) else channels
