"""AIM-BEV in torch, for training; only `train` imports this module."""

from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from regents_cosim.planners.aim_bev.architecture import (
    BLOCKS,
    COORDINATE_M,
    FAR_TARGET_M,
    FEATURES,
    HIDDEN,
    KNOWN,
    LAST,
    MLP,
    NEARNESS,
    NORM_EPSILON,
    SPEED_M_S,
    STEM,
    WAYPOINT_S,
    WAYPOINTS,
    Block,
    squeezed,
)


class AimBevNetwork(nn.Module):
    """The network from views [batch, 3, 192, 192] in 0..1 and further inputs to waypoints [batch, 8, 2] [m].

    The inputs are speeds [batch] [m/s], targets [batch, 2] [m], and the nearness of the next closed light [batch],
    0..1. Targets and waypoints are in the ego's frame, x ahead and y to the left.
    """

    def __init__(self) -> None:
        super().__init__()
        self.encoder = Encoder()
        self.join = nn.Linear(LAST, FEATURES)
        sizes = (FEATURES + KNOWN, *MLP)
        self.mlp = nn.Sequential(*(nn.Linear(a, b) for a, b in pairwise(sizes)))
        self.gru = nn.GRUCell(6, HIDDEN)
        self.output = nn.Linear(HIDDEN, 2)

    def forward(self, view: Tensor, speed: Tensor, target: Tensor, light: Tensor) -> Tensor:
        """Waypoints [m]."""
        return self.plan(self.encoder(view), speed, target, light)

    def plan(self, features: Tensor, speed: Tensor, target: Tensor, light: Tensor) -> Tensor:
        """Waypoints [m] from the encoder's features [batch, 576]."""
        known = torch.stack([speed / SPEED_M_S, NEARNESS * light], dim=1)
        hidden = torch.cat([functional.relu(self.join(features)), known], dim=1)
        for layer in self.mlp:
            hidden = functional.relu(layer(hidden))
        near = torch.clamp(FAR_TARGET_M / torch.linalg.norm(target, dim=1, keepdim=True).clamp(min=1e-3), max=1.0)
        goal = target * near / COORDINATE_M
        straight = torch.stack([speed, torch.zeros_like(speed)], dim=1) * (WAYPOINT_S / COORDINATE_M)
        point, found = torch.zeros_like(goal), []
        for _ in range(WAYPOINTS):
            hidden = self.gru(torch.cat([point, goal, goal - point], dim=1), hidden)
            point = point + straight + self.output(hidden)
            found.append(point)
        return torch.stack(found, dim=1) * COORDINATE_M

    def arrays(self) -> dict[str, np.ndarray]:
        """The weights by name."""
        state = self.state_dict().items()
        return {name: values.detach().cpu().numpy() for name, values in state if values.is_floating_point()}


class Encoder(nn.Module):
    """MobileNetV3-small without its classifier: [batch, 3, height, width] to [batch, 576]."""

    def __init__(self) -> None:
        super().__init__()
        stem = _convolution(3, STEM, 3, 2, 1, nn.Hardswish())
        last = _convolution(BLOCKS[-1].outputs, LAST, 1, 1, 1, nn.Hardswish())
        self.features = nn.Sequential(stem, *map(InvertedResidual, BLOCKS), last)

    def forward(self, view: Tensor) -> Tensor:
        """Features, averaged over the picture."""
        return self.finish(view, 0)

    def begin(self, view: Tensor, layers: int) -> Tensor:
        """The output of the first few layers for a view."""
        return self.features[:layers](view)

    def finish(self, x: Tensor, layers: int) -> Tensor:
        """Features from the output of the first few layers."""
        return self.features[layers:](x).mean(dim=(2, 3))


class InvertedResidual(nn.Module):
    """An inverted residual block: expand, filter each channel, squeeze and excite, project."""

    def __init__(self, shape: Block) -> None:
        super().__init__()
        activation = nn.Hardswish if shape.hard_swish else nn.ReLU
        layers: list[nn.Module] = []
        if shape.expanded != shape.inputs:
            layers.append(_convolution(shape.inputs, shape.expanded, 1, 1, 1, activation()))
        layers.append(
            _convolution(shape.expanded, shape.expanded, shape.kernel, shape.stride, shape.expanded, activation())
        )
        if shape.squeeze:
            layers.append(SqueezeExcitation(shape.expanded))
        layers.append(_convolution(shape.expanded, shape.outputs, 1, 1, 1, nn.Identity()))
        self.block = nn.Sequential(*layers)
        self.adds = shape.stride == 1 and shape.inputs == shape.outputs

    def forward(self, x: Tensor) -> Tensor:
        """The block's output, added to its input where the shapes allow."""
        return x + self.block(x) if self.adds else self.block(x)


class SqueezeExcitation(nn.Module):
    """Squeeze and excitation: weights channels by their mean over the picture."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.fc1 = nn.Conv2d(channels, squeezed(channels), 1)
        self.fc2 = nn.Conv2d(squeezed(channels), channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """The weighted channels."""
        mean = x.mean(dim=(2, 3), keepdim=True)
        return x * functional.hardsigmoid(self.fc2(functional.relu(self.fc1(mean))))


def _convolution(
    inputs: int, outputs: int, kernel: int, stride: int, groups: int, activation: nn.Module
) -> nn.Sequential:
    convolution = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outputs, eps=NORM_EPSILON, momentum=0.05), activation)
