"""Planners that try to leave, each in one way and at one place: `os_exit_in_factory`, say, or `exit_in_jax_step`.

Those that drive leave in the case `bad` alone.
"""

import os
import sys

import jax
import jax.numpy as jnp

from regents_cosim import Control
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.planners.jax_planner import JaxPlanner


def _raise(error):
    raise error


HOWS = {
    "exit": lambda: sys.exit(0),
    "interrupt": lambda: _raise(KeyboardInterrupt()),
    "generator_exit": lambda: _raise(GeneratorExit()),
    "os_exit": lambda: os._exit(0),
    "error": lambda: _raise(KeyError("lost")),
}
SAID = {
    "exit": "SystemExit",
    "interrupt": "KeyboardInterrupt",
    "generator_exit": "GeneratorExit",
    "os_exit": "SystemExit",
    "error": "KeyError",
}
MAKING = ("factory", "construction", "attribute")
ON_HOST = ("reset", "act")
CALLED_BACK = "jax_callback"  # from the compiled program, in whatever thread that runs
TRACED = ("jax_init", "jax_look", "jax_step", "jax_keep", "jax_recall")


class Straight:
    def reset(self, scene):
        self.bad = scene.id == "bad"

    def act(self, observation):
        return Control(0.0, 0.0)


class StraightInJax(JaxPlanner):
    """Has a memory of another shape in the case `bad`, so that its programs are traced for that case alone."""

    def init(self, scene):
        return jnp.zeros(2 if scene.scenario.id == "bad" else 1)

    def step(self, memory, sight, ego):
        return ControlArrays(accel=jnp.float32(0.0), curvature=jnp.float32(0.0)), memory

    def keep(self, last):
        return last


def _made(how, place):
    leave = HOWS[how]
    if place == "factory":
        return lambda: leave()
    if place == "construction":
        return type("Leaves", (Straight,), {"__init__": lambda self: leave()})
    if place == "attribute":
        return type("Leaves", (), {"reset": property(lambda self: leave()), "act": Straight.act})()
    if place == "reset":
        return type("Leaves", (Straight,), {"reset": lambda self, scene: scene.id == "bad" and leave()})
    if place == "act":
        return type("Leaves", (Straight,), {"act": lambda self, seen: leave() if self.bad else Control(0.0, 0.0)})
    if place == CALLED_BACK:
        return _calls_back(leave)
    verb = place.removeprefix("jax_")
    usual = getattr(StraightInJax, verb)

    def leaving(self, *given):
        is_bad = given[0].scenario.id == "bad" if verb == "init" else given[0].shape == (2,)
        return leave() if is_bad else usual(self, *given)

    return type("Leaves", (StraightInJax,), {verb: leaving})()


def _calls_back(leave):
    def left(memory):
        leave()
        return memory

    def step(self, memory, sight, ego):
        if memory.shape == (2,):
            memory = jax.pure_callback(
                left, jax.ShapeDtypeStruct(memory.shape, memory.dtype), jax.lax.stop_gradient(memory),
                vmap_method="sequential",
            )  # fmt: skip
        return ControlArrays(accel=0.0 * memory[0], curvature=jnp.float32(0.0)), memory

    return type("Leaves", (StraightInJax,), {"step": step})()


PLANNERS = {
    f"{how}_in_{place}": _made(how, place) for how in HOWS for place in (*MAKING, *ON_HOST, CALLED_BACK, *TRACED)
}
globals().update(PLANNERS)
