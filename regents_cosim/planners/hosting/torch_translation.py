"""Translate a torch module into JAX, operation by operation, from the graph that `torch.export` makes.

`torch.export` reduces a module to the core operations of ATen, including GRUs, LSTMs and attention, and refuses control
flow that depends on values (an `if` on a tensor). The operations of usual planner networks are translated here; any
other operation, and a result that differs from torch's, raises NotTranslatedError.

Of the translators on PyPI, torchax 0.0.13 cannot be imported with torch 2.13, and torch2jax 0.1.0 knows neither the
division of a tensor by a number nor convolutions, GRU cells or `amax`.
"""

import io
import logging
import operator
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr
from itertools import accumulate
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from regents_cosim.errors import RegentsError
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.system.foreign_code import foreign_code, said_by

if TYPE_CHECKING:
    from torch import Tensor, nn

_TOLERANCE = 1e-4  # relative to the answer: float32 in another order
_NOT_OURS = {"device", "layout", "pin_memory", "memory_format", "non_blocking", "implicit"}


class NotTranslatedError(RegentsError):
    """The module cannot be translated into JAX, and why."""


class _Value(NamedTuple):
    """An earlier result, or an input, by its name."""

    name: str


class _Step(NamedTuple):
    """One operation of the graph."""

    name: str
    operation: str
    args: tuple[Any, ...]
    options: tuple[tuple[str, Any], ...]


class Translated(eqx.Module):
    """The translated module, called like the module; modules that differ only in weights share one compilation."""

    weights: dict[str, Array]
    inputs: tuple[str, ...] = eqx.field(static=True)
    steps: tuple[_Step, ...] = eqx.field(static=True)
    output: str = eqx.field(static=True)

    def __call__(self, *given: Array) -> Array:
        """The module's answer to arrays of the shapes that it was translated for."""
        known: dict[str, Any] = {**self.weights, **dict(zip(self.inputs, given, strict=True))}
        for step in self.steps:
            options = {name: _known(value, known) for name, value in step.options}
            known[step.name] = _OPERATIONS[step.operation](*_known(step.args, known), **options)
        return known[self.output]


def translate(module: "nn.Module", *examples: "Tensor") -> Translated:
    """Translate a module for inputs of the shapes of `examples`. Raises NotTranslatedError."""
    import torch

    # torch, JAX and the module itself may each raise their own errors
    with foreign_code(lambda error: NotTranslatedError(said_by(error))):
        with _quiet():
            program = torch.export.export(module, examples).run_decompositions()
        translated = _translated(program)
        with torch.no_grad():
            wanted = module(*examples).numpy()
        got = np.asarray(
            compiled(lambda *given: translated(*given))(*(jnp.asarray(example.numpy()) for example in examples))
        )
    if got.shape != wanted.shape or not np.allclose(got, wanted, _TOLERANCE, _TOLERANCE * np.abs(wanted).max()):
        raise NotTranslatedError("JAX computes something else than torch")
    return translated


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence torch's messages for developers about a module that it cannot export."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings(), redirect_stderr(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)


def _translated(program: Any) -> Translated:
    held = {**program.state_dict, **program.constants}
    specs = {spec.arg.name: spec for spec in program.graph_signature.input_specs}
    steps, inputs, weights, output = [], [], {}, []
    for node in program.graph.nodes:
        if node.op == "placeholder" and specs[node.name].kind.name == "USER_INPUT":
            inputs.append(node.name)
        elif node.op == "placeholder":
            weights[node.name] = jnp.asarray(held[specs[node.name].target].detach().cpu().numpy())
        elif node.op == "call_function":
            steps.append(_step(node))
        elif node.op == "output":
            output = [value.name for value in node.args[0]]
    if len(output) != 1:
        raise NotTranslatedError(f"{len(output)} results, expected one (a module that changes its buffers?)")
    return Translated(weights, tuple(inputs), tuple(steps), output[0])


def _step(node: Any) -> _Step:
    operation = "getitem" if node.target is operator.getitem else str(node.target).split(".")[1]
    if operation not in _OPERATIONS:
        raise NotTranslatedError(f"{node.target} is not among the operations that are translated")
    options = tuple((name, _frozen(value)) for name, value in node.kwargs.items() if name not in _NOT_OURS)
    return _Step(node.name, operation, _frozen(node.args), options)


def _frozen(value: Any) -> Any:
    """An argument in hashable form, as `Translated` is static to JAX except for its weights."""
    import torch

    if isinstance(value, torch.fx.Node):
        return _Value(value.name)
    if isinstance(value, torch.dtype):
        return str(value).removeprefix("torch.")
    if isinstance(value, list | tuple):
        return tuple(_frozen(one) for one in value)
    return value


def _known(value: Any, known: dict[str, Any]) -> Any:
    if isinstance(value, _Value):
        return known[value.name]
    if isinstance(value, tuple):
        return tuple(_known(one, known) for one in value)
    return value


# --- the operations, with the arguments that torch gives them ---------------------------------


def _over(reduce: Callable[..., Array]) -> Callable[..., Array]:
    """A reduction over the given axes, or over all if none is given."""

    def reduced(x: Array, dim: Any = None, keepdim: bool = False, dtype: str | None = None) -> Array:
        found = reduce(x, axis=None if dim == () else dim, keepdims=keepdim)
        return found if dtype is None else found.astype(dtype)

    return reduced


def _slice(x: Array, dim: int = 0, start: int | None = None, end: int | None = None, step: int = 1) -> Array:
    return x[(slice(None),) * (dim % x.ndim) + (slice(start, end, step),)]


def _split(x: Array, sizes: tuple[int, ...], dim: int = 0) -> list[Array]:
    return jnp.split(x, list(accumulate(sizes[:-1])), axis=dim)


def _expand(x: Array, shape: tuple[int, ...]) -> Array:
    old = (1,) * (len(shape) - x.ndim) + x.shape
    return jnp.broadcast_to(x, [before if wanted == -1 else wanted for wanted, before in zip(shape, old, strict=True)])


def _norm(x: Array, order: float | int = 2, dim: Any = None, keepdim: bool = False) -> Array:
    return (jnp.abs(x) ** order).sum(dim, keepdims=keepdim) ** (1.0 / order)


def _normalised(x: Array, axes: tuple[int, ...], epsilon: float) -> Array:
    mean = x.mean(axes, keepdims=True)
    return (x - mean) / jnp.sqrt(jnp.square(x - mean).mean(axes, keepdims=True) + epsilon)


def _layer_norm(x: Array, shape: tuple[int, ...], weight: Any, bias: Any, epsilon: float) -> tuple[Array]:
    found = _normalised(x, tuple(range(-len(shape), 0)), epsilon)
    found = found if weight is None else found * weight
    return (found if bias is None else found + bias,)


def _batch_norm(
    x: Array, weight: Any, bias: Any, mean: Array, variance: Array, momentum: float, epsilon: float
) -> tuple[Array]:
    along = (-1,) + (1,) * (x.ndim - 2)
    found = (x - mean.reshape(along)) / jnp.sqrt(variance.reshape(along) + epsilon)
    found = found if weight is None else found * weight.reshape(along)
    return (found if bias is None else found + bias.reshape(along),)


def _convolution(
    x: Array, weight: Array, bias: Any, stride: Any, padding: Any, dilation: Any, transposed: bool, _: Any, groups: int
) -> Array:
    if transposed:
        raise NotTranslatedError("transposed convolutions are not translated")
    pads = [(pad, pad) for pad in padding]
    found = jax.lax.conv_general_dilated(x, weight, stride, pads, rhs_dilation=dilation, feature_group_count=groups)
    return found if bias is None else found + bias.reshape((-1,) + (1,) * (x.ndim - 2))


def _pad(x: Array, pads: tuple[int, ...], value: float | int = 0) -> Array:
    pairs = list(zip(pads[::2], pads[1::2], strict=True))[::-1]  # torch begins with the last axis
    return jnp.pad(x, [(0, 0)] * (x.ndim - len(pairs)) + pairs, constant_values=value)


def _extreme(pick: Callable[..., Array], index: Callable[..., Array]) -> Callable[..., Any]:
    """`max` or `min`: of everything, or along an axis, then with the indices."""

    def found(x: Array, dim: int | None = None, keepdim: bool = False) -> Any:
        if dim is None:
            return pick(x)
        return pick(x, axis=dim, keepdims=keepdim), index(x, axis=dim, keepdims=keepdim)

    return found


_OPERATIONS: dict[str, Callable[..., Any]] = {
    "getitem": operator.getitem,
    # value by value
    "add": lambda x, y, alpha=1: x + y * alpha,
    "sub": lambda x, y, alpha=1: x - y * alpha,
    "mul": operator.mul,
    "div": operator.truediv,
    "pow": operator.pow,
    "neg": operator.neg,
    "eq": operator.eq,
    "ne": operator.ne,
    "lt": operator.lt,
    "le": operator.le,
    "gt": operator.gt,
    "ge": operator.ge,
    "logical_not": jnp.logical_not,
    "logical_and": jnp.logical_and,
    "logical_or": jnp.logical_or,
    "bitwise_not": jnp.bitwise_not,
    "bitwise_and": jnp.bitwise_and,
    "bitwise_or": jnp.bitwise_or,
    "where": jnp.where,
    "maximum": jnp.maximum,
    "minimum": jnp.minimum,
    "clamp": jnp.clip,
    "hardtanh": lambda x, low=-1.0, high=1.0: jnp.clip(x, low, high),
    "relu": jax.nn.relu,
    "leaky_relu": jax.nn.leaky_relu,
    "elu": lambda x, alpha=1.0, scale=1.0, inner=1.0: scale * jnp.where(x > 0, x, alpha * jnp.expm1(x * inner)),
    "gelu": lambda x, approximate="none": jax.nn.gelu(x, approximate == "tanh"),
    "sigmoid": jax.nn.sigmoid,
    "tanh": jnp.tanh,
    "abs": jnp.abs,
    "sign": jnp.sign,
    "floor": jnp.floor,
    "exp": jnp.exp,
    "expm1": jnp.expm1,
    "log": jnp.log,
    "log1p": jnp.log1p,
    "sqrt": jnp.sqrt,
    "rsqrt": jax.lax.rsqrt,
    "reciprocal": jnp.reciprocal,
    "sin": jnp.sin,
    "cos": jnp.cos,
    "atan": jnp.arctan,
    "atan2": jnp.arctan2,
    # over axes
    "sum": _over(jnp.sum),
    "mean": _over(jnp.mean),
    "amax": _over(jnp.max),
    "amin": _over(jnp.min),
    "any": _over(jnp.any),
    "max": _extreme(jnp.max, jnp.argmax),
    "min": _extreme(jnp.min, jnp.argmin),
    "argmax": lambda x, dim=None, keepdim=False: jnp.argmax(x, dim, keepdims=keepdim),
    "argmin": lambda x, dim=None, keepdim=False: jnp.argmin(x, dim, keepdims=keepdim),
    "cumsum": jnp.cumsum,
    "var": lambda x, dim=None, correction=1, keepdim=False: jnp.var(x, dim, ddof=correction, keepdims=keepdim),
    "linalg_vector_norm": _norm,
    "_softmax": lambda x, dim, _: jax.nn.softmax(x, dim),
    "_log_softmax": lambda x, dim, _: jax.nn.log_softmax(x, dim),
    "native_layer_norm": _layer_norm,
    "_native_batch_norm_legit_no_training": _batch_norm,
    # linear
    "mm": jnp.matmul,
    "bmm": jnp.matmul,
    "addmm": lambda x, y, z, beta=1, alpha=1: beta * x + alpha * (y @ z),
    "convolution": _convolution,
    # shapes
    "view": jnp.reshape,
    "permute": jnp.transpose,
    "unsqueeze": jnp.expand_dims,
    "squeeze": lambda x, dims: jnp.squeeze(x, tuple(d for d in np.atleast_1d(dims).tolist() if x.shape[d] == 1)),
    "expand": _expand,
    "repeat": jnp.tile,
    "cat": lambda values, dim=0: jnp.concatenate(values, dim),
    "slice": _slice,
    "select": lambda x, dim, index: jnp.take(x, index, dim),
    "index_select": lambda x, dim, index: jnp.take(x, index, dim),
    "gather": lambda x, dim, index: jnp.take_along_axis(x, index, dim),
    "split_with_sizes": _split,
    "flip": jnp.flip,
    "constant_pad_nd": _pad,
    # copies and constants
    "clone": jnp.asarray,
    "alias": jnp.asarray,
    "_to_copy": jnp.asarray,
    "full": jnp.full,
    "full_like": jnp.full_like,
    "scalar_tensor": jnp.asarray,
}
