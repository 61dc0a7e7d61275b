"""Environments of highway-env by name: its own, or a user's, which a module registers or holds as a class or function.

An environment runs without its wrappers, as it does beside a planner.
"""

import warnings
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import gymnasium
import highway_env
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.envs.common.observation import GrayscaleObservation
from highway_env.vehicle.graphics import VehicleGraphics

from regents_cosim.checks.names import did_you_mean
from regents_cosim.errors import RegentsError, require
from regents_cosim.simulators.highway import skip_wayland
from regents_cosim.system.foreign_code import foreign_code, said_by
from regents_cosim.system.user_code import import_named

skip_wayland()


def environments() -> list[str]:
    """Ids of highway-env's environments that have one controlled vehicle."""
    highway_env._register_highway_envs()
    own = [name for name, spec in gymnasium.registry.items() if str(spec.entry_point).startswith("highway_env")]
    return sorted(name for name in own if "multi-agent" not in name)


def find_environment(name: str) -> Callable[[], Any]:
    """What makes an environment of highway-env, or of `package.module:NAME` or `file.py:NAME`.

    NAME is an id that the module registers, or its class or function. Raises RegentsError where there is none.
    """
    known = environments()
    module_name, _, own = name.rpartition(":")
    if not module_name:
        hint = "(or name your own: `package.module:NAME` or `file.py:NAME`, an id that it registers or a class in it)"
        require(
            name in known, f"highway-env has no environment {name!r}: {did_you_mean(name, known)} {hint}", RegentsError
        )
        return partial(gymnasium.make, name, disable_env_checker=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # gymnasium's, where a module registers the same id again
        module = import_named(module_name, f"environment {name!r}")
    if own in gymnasium.registry:
        return partial(gymnasium.make, own, disable_env_checker=True)
    found = getattr(module, own, None)
    if not callable(found):
        raise RegentsError(
            f"environment {name!r}: {module_name} registers no {own!r}, and has no class or function of that name"
        )
    return found


def require_rate(wanted: Any, frequency: int) -> None:
    """Raise RegentsError where a policy that is asked `wanted` times a second is asked between two steps."""
    rates = ", ".join(str(rate) for rate in range(1, frequency + 1) if frequency % rate == 0)
    require(
        isinstance(wanted, int | float) and wanted > 0 and frequency % wanted == 0,
        f"policy_frequency {wanted!r} Hz, expected a divisor of {frequency} Hz, the case's: {rates}",
        RegentsError,
    )


def make_environment(name: str, config: dict[str, Any]) -> AbstractEnv:
    """An environment by name with these settings, which count from the next reset on. Raises RegentsError."""
    make = find_environment(name)
    failed = foreign_code(lambda error: RegentsError(f"environment {name!r} cannot be made: {said_by(error)}"))
    with failed, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # environments with a newer version warn about it
        env = make().unwrapped
        if isinstance(env, AbstractEnv):
            env.configure(config)
            return env
    raise RegentsError(
        f"environment {name!r} is {type(env).__name__}, expected a subclass of highway-env's AbstractEnv"
    )


def sees_pictures(env: AbstractEnv) -> bool:
    """Whether the agent of an environment sees what is drawn, so that colours would tell it who attacks."""
    return GrayscaleObservation.__name__ in str(env.config["observation"])


def hide_roles(env: AbstractEnv, vehicles: Iterable[Any]) -> None:
    """Give scripted vehicles the colour of highway-env's own traffic where the agent sees pictures."""
    if sees_pictures(env):
        for vehicle in vehicles:
            vehicle.color = VehicleGraphics.BLUE
