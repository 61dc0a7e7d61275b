"""AIM-BEV in JAX, which runs inside the compiled loop with the weights that torch trained.

Batch norm is folded into the convolutions, and a depthwise convolution is a sum of shifted products, as XLA's own takes
nine times as long on a CPU. Pictures are [row column channel].
"""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt8

from regents_cosim.errors import RegentsError
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.planners.aim_bev.architecture import (
    BLOCKS,
    COORDINATE_M,
    FAR_TARGET_M,
    HIDDEN,
    MLP,
    NEARNESS,
    NORM_EPSILON,
    SPEED_M_S,
    WAYPOINT_S,
    WAYPOINTS,
)

Weights = Mapping[str, np.ndarray]


class Linear(eqx.Module):
    """A linear layer: x @ weight + bias."""

    weight: Float[Array, "input output"]
    bias: Float[Array, " output"]

    def __call__(self, x: Float[Array, "*axes input"]) -> Float[Array, "*axes output"]:
        """Apply the layer."""
        return x @ self.weight + self.bias


class Filter(eqx.Module):
    """A depthwise convolution."""

    weight: Float[Array, "row column channel"]
    bias: Float[Array, " channel"]
    stride: int = eqx.field(static=True)

    def __call__(self, x: Float[Array, "row column channel"]) -> Float[Array, "less fewer channel"]:
        """Filter every channel by itself, with zeros around the picture."""
        size = self.weight.shape[0]
        rows, columns = (-(-side // self.stride) for side in x.shape[:2])
        padded = jnp.pad(x, ((size // 2, size // 2), (size // 2, size // 2), (0, 0)))
        total = self.bias
        for i in range(size):
            for j in range(size):
                part = padded[i : i + rows * self.stride : self.stride, j : j + columns * self.stride : self.stride]
                total = total + part[:rows, :columns] * self.weight[i, j]
        return total


class Residual(eqx.Module):
    """An inverted residual block: expand, filter each channel, squeeze and excite, project."""

    expand: Linear | None
    depthwise: Filter
    squeeze: tuple[Linear, Linear] | None
    project: Linear
    hard_swish: bool = eqx.field(static=True)
    adds: bool = eqx.field(static=True)

    def __call__(self, x: Float[Array, "row column input"]) -> Float[Array, "less fewer output"]:
        """The block's output, added to its input where the shapes allow."""
        activation = jax.nn.hard_swish if self.hard_swish else jax.nn.relu
        inner = x if self.expand is None else activation(self.expand(x))
        inner = activation(self.depthwise(inner))
        if self.squeeze is not None:
            fc1, fc2 = self.squeeze
            inner = inner * jax.nn.hard_sigmoid(fc2(jax.nn.relu(fc1(inner.mean(axis=(0, 1))))))
        out = self.project(inner)
        return x + out if self.adds else out


class NetworkWeights(eqx.Module):
    """The weights of the whole network."""

    stem: Float[Array, "3 3 3 channel"]
    stem_bias: Float[Array, " channel"]
    blocks: tuple[Residual, ...]
    last: Linear
    join: Linear
    mlp: tuple[Linear, ...]
    gru_input: Linear
    gru_hidden: Linear
    output: Linear

    def __call__(
        self,
        view: UInt8[Array, "192 192 3"],
        speed: Float[Array, ""],
        target: Float[Array, " 2"],
        light: Float[Array, ""],
    ) -> Float[Array, "waypoint 2"]:
        """Waypoints [m] from the view, the ego's speed [m/s], its target [m] and the nearness of a closed light.

        Target and waypoints are in the frame of the ego, x ahead.
        """
        known = jnp.stack([speed / SPEED_M_S, NEARNESS * light])
        hidden = jnp.concatenate([jax.nn.relu(self.join(self.encode(view))), known])
        for layer in self.mlp:
            hidden = jax.nn.relu(layer(hidden))
        return self._unroll(hidden, speed, target)

    def encode(self, view: UInt8[Array, "192 192 3"]) -> Float[Array, " feature"]:
        """The features of a view, averaged over the picture."""
        x = jax.nn.hard_swish(self._stem(view))
        for block in self.blocks:
            x = block(x)
        return jax.nn.hard_swish(self.last(x)).mean(axis=(0, 1))

    def _stem(self, view: UInt8[Array, "192 192 3"]) -> Float[Array, "96 96 channel"]:
        """The first convolution, also as shifted products: with three inputs that is faster than XLA's own."""
        padded = jnp.pad(view, ((1, 1), (1, 1), (0, 0))).astype(jnp.float32)
        total = self.stem_bias
        for i in range(3):
            for j in range(3):
                part = padded[i : i + view.shape[0] : 2, j : j + view.shape[1] : 2]
                for channel in range(3):
                    total = total + part[..., channel, None] * self.stem[i, j, channel]
        return total

    def _unroll(self, hidden: Array, speed: Array, target: Array) -> Float[Array, "waypoint 2"]:
        near = jnp.minimum(FAR_TARGET_M / jnp.maximum(jnp.hypot(target[0], target[1]), 1e-3), 1.0)
        goal = target * near / COORDINATE_M
        straight = jnp.stack([speed, jnp.zeros_like(speed)]) * (WAYPOINT_S / COORDINATE_M)
        point, found = jnp.zeros_like(goal), []
        for _ in range(WAYPOINTS):
            given = self.gru_input(jnp.concatenate([point, goal, goal - point]))
            kept = self.gru_hidden(hidden)
            reset, update = jnp.split(jax.nn.sigmoid(given[: 2 * HIDDEN] + kept[: 2 * HIDDEN]), 2)
            new = jnp.tanh(given[2 * HIDDEN :] + reset * kept[2 * HIDDEN :])
            hidden = (1.0 - update) * new + update * hidden
            point = point + straight + self.output(hidden)
            found.append(point)
        return jnp.stack(found) * COORDINATE_M


def to_network(weights: Weights) -> NetworkWeights:
    """The network with the weights of a file. Raises RegentsError where an array is missing or has another shape."""
    try:
        return _assembled({name: values.astype(np.float32) for name, values in weights.items()})
    except (KeyError, ValueError) as error:
        raise RegentsError(f"these are no weights of AIM-BEV: {error}") from error


def _assembled(weights: Weights) -> NetworkWeights:
    features = "encoder.features"
    stem, stem_bias = _folded(weights, f"{features}.0")
    blocks = tuple(_block(weights, index) for index in range(len(BLOCKS)))
    return NetworkWeights(
        # torch was given levels of 0..1
        stem=on_device(stem.transpose(2, 3, 1, 0) / 255.0, np.float32),
        stem_bias=on_device(stem_bias, np.float32),
        blocks=blocks,
        last=_pointwise(weights, f"{features}.{len(BLOCKS) + 1}"),
        join=_linear(weights, "join"),
        mlp=tuple(_linear(weights, f"mlp.{index}") for index in range(len(MLP))),
        gru_input=_product(weights["gru.weight_ih"].T, weights["gru.bias_ih"]),
        gru_hidden=_product(weights["gru.weight_hh"].T, weights["gru.bias_hh"]),
        output=_linear(weights, "output"),
    )


def _block(weights: Weights, index: int) -> Residual:
    shape, name = BLOCKS[index], f"encoder.features.{index + 1}.block"
    expands = shape.expanded != shape.inputs
    at = int(expands)
    kernel, bias = _folded(weights, f"{name}.{at}")
    squeeze = None
    if shape.squeeze:
        fc1, fc2 = (_linear(weights, f"{name}.{at + 1}.{layer}") for layer in ("fc1", "fc2"))
        squeeze = (fc1, fc2)
    return Residual(
        expand=_pointwise(weights, f"{name}.0") if expands else None,
        depthwise=Filter(
            on_device(kernel[:, 0].transpose(1, 2, 0), np.float32), on_device(bias, np.float32), shape.stride
        ),
        squeeze=squeeze,
        project=_pointwise(weights, f"{name}.{at + 1 + shape.squeeze}"),
        hard_swish=shape.hard_swish,
        adds=shape.stride == 1 and shape.inputs == shape.outputs,
    )


def _folded(weights: Weights, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Kernel and bias of a convolution, with the batch norm behind it folded in."""
    norm = {key: weights[f"{name}.1.{key}"] for key in ("weight", "bias", "running_mean", "running_var")}
    scale = norm["weight"] / np.sqrt(norm["running_var"] + np.float32(NORM_EPSILON))
    return weights[f"{name}.0.weight"] * scale[:, None, None, None], norm["bias"] - norm["running_mean"] * scale


def _pointwise(weights: Weights, name: str) -> Linear:
    kernel, bias = _folded(weights, name)
    return _product(kernel[:, :, 0, 0].T, bias)


def _linear(weights: Weights, name: str) -> Linear:
    weight = weights[f"{name}.weight"]
    return _product(weight.reshape(weight.shape[:2]).T, weights[f"{name}.bias"])


def _product(weight: np.ndarray, bias: np.ndarray) -> Linear:
    return Linear(on_device(weight, np.float32), on_device(bias, np.float32))
