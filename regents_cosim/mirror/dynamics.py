"""One interface for all models of motion: bicycle, point mass, and the twin of highway-env's vehicle."""

import equinox as eqx
import jax
from jaxtyping import Array, Bool, Float

from regents_cosim.mirror import bicycle, highway_bicycle
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.scenario.attack_record import Dynamics


class Mobility(eqx.Module):
    """The models of motion of some agents: bicycle and point mass, or highway-env's vehicle for all."""

    half_length: Float[Array, "*#axes"]  # [m]
    # marks pedestrians, point masses that can turn on the spot; None: there are none
    walks: Bool[Array, "*#axes"] | None = None
    dynamics: Dynamics = eqx.field(static=True, default="bicycle")

    def step(self, state: Motion, control: ControlArrays, dt: Float[Array, ""] | float) -> Motion:
        """The state one step of `dt` [s] later; all fields broadcast."""
        if self.dynamics == "highway":
            return highway_bicycle.step(state, control, self.half_length, dt)
        return bicycle.step(state, control, dt, self.walks)

    def roll_out(
        self, start: Motion, controls: ControlArrays, moving: Bool[Array, "agent step"], dt: Float[Array, ""] | float
    ) -> Motion:
        """Motion [agent, step + 1] from `start` [agent] under `controls` [agent, step]; agents wait until `moving`."""
        if self.dynamics == "highway":
            return highway_bicycle.roll_out(start, controls, moving, self.half_length, dt)
        return bicycle.roll_out(start, controls, moving, dt, self.walks)

    def pull_back(
        self,
        start: Motion,
        controls: ControlArrays,
        moving: Bool[Array, "agent step"],
        dt: Float[Array, ""] | float,
        motion: Motion,
        heading: tuple[Float[Array, "agent time"], Float[Array, "agent time"]],
        gradient: Motion,
    ) -> ControlArrays:
        """The gradient with respect to `controls`, given the `gradient` with respect to their roll-out `motion`.

        `heading` is the cosine and sine of the yaw of `motion`. highway-env's model is rolled out once more.
        """
        if self.dynamics == "highway":
            _, back = jax.vjp(lambda own: self.roll_out(start, own, moving, dt), controls)
            return back(gradient)[0]
        return bicycle.pull_back(controls, moving, dt, motion, heading, gradient, self.walks)[1]

    def controls_between(self, motion: Motion, dt: Float[Array, ""] | float) -> ControlArrays:
        """Controls [agent, step] that lead from each state of `motion` [agent, step + 1] to the next."""
        if self.dynamics == "highway":
            return highway_bicycle.controls_between(motion, dt)
        return bicycle.controls_between(motion, dt, self.walks)
