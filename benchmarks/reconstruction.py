"""`python -m benchmarks reconstruction`: how well the mirror drives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from regents_cosim.mirror.bicycle import ControlArrays, clip
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.rollout import roll_out_background
from regents_cosim.mirror.world import World, to_roadless_world
from regents_cosim.scenario.scenario import Scenario


@dataclass(frozen=True)
class ReconstructionRow:
    """How far roll-outs of the estimated controls are from the recorded tracks."""

    network: str
    windows: int
    agents: int
    smooth_mean_cm: float
    smooth_p99_cm: float
    smooth_max_cm: float
    local_mean_cm: float
    local_p99_cm: float


@in_float32
def reconstruction_row(network: str, scenarios: Sequence[Scenario]) -> ReconstructionRow:
    """Position errors over all agents and valid steps of `scenarios`."""
    smooth, local = [], []
    for scenario in scenarios:
        world = to_roadless_world(scenario)
        smooth.append(_errors(world, world.controls))
        local.append(_errors(world, clip(world.mobility.controls_between(world.log, world.dt))))
    fitted, differences = 100.0 * np.concatenate(smooth), 100.0 * np.concatenate(local)
    return ReconstructionRow(
        network=network,
        windows=len(scenarios),
        agents=sum(len(scenario.agents) for scenario in scenarios),
        smooth_mean_cm=float(fitted.mean()),
        smooth_p99_cm=float(np.percentile(fitted, 99)),
        smooth_max_cm=float(fitted.max()),
        local_mean_cm=float(differences.mean()),
        local_p99_cm=float(np.percentile(differences, 99)),
    )


_roll_out = compiled(roll_out_background)


def _errors(world: World, controls: ControlArrays) -> Float[np.ndarray, " sample"]:
    """Distance [m] of the roll-out to the log at every valid step."""
    motion = _roll_out(world, controls)
    miss = np.hypot(np.asarray(motion.x - world.log.x, float), np.asarray(motion.y - world.log.y, float))
    return miss[np.asarray(world.valid)]
