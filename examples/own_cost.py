"""Ask an attack for more than a crash: here for an adversary that brakes as little as it can.

A cost is a function of the scene, of the motion of all agents (the ego is row 0) and of their controls, in JAX. It
is added to the attack's own and must be differentiable.
"""

import jax.numpy as jnp

from regents_cosim import REGENTS, attack, network_config, record


def braking(world, motion, controls):
    """Mean deceleration of all others [m/s^2], times a weight."""
    return 5.0 * jnp.maximum(-controls.accel[1:], 0.0).mean()


def hardest_braking(case):
    """The hardest braking of the adversary [m/s^2]."""
    return max(0.0, -case.tracks.accel[case.adversary].min())


windows = record(network_config("crossing"), count=4, seed=0)
for name, cost in (("the attack's own cost", None), ("with ours", braking)):
    crashes = [c for c in attack(windows, REGENTS, "idm", extra_cost=cost) if c.crash]
    hardest = ", ".join(f"{hardest_braking(case):.1f}" for case in crashes)
    print(f"{name}: {len(crashes)} crashes, hardest braking [m/s^2] {hardest}")
