"""The direction in which the cost pulls an adversary, for every place around the ego.

The gradient is that of one term of C_ego_col (ReGentS eq. 4), the distance at one moment, as the
rules of section 3.3 look at single moments: by a curvature and an acceleration that the adversary
held over the seconds before. Both drove straight at the same speed, and the adversary is now at
one of many places around the ego, turned by some angle.
"""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from benchmarks.gallery.roads import straight_road
from benchmarks.gallery.scenes import Car, traffic
from regents_cosim.attacks.accept.rules import FRONT_WINDOW_RAD, REAR_SECTOR_RAD
from regents_cosim.attacks.descent.costs import total_cost
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.methods.presets import KING
from regents_cosim.geometry.frames import wrap
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.rollout import roll_out_background
from regents_cosim.mirror.world import World, to_world

SPEED_M_S = 10.0
HELD_S = 8.0  # the horizon of the attack
AHEAD_M = np.arange(-42.0, 42.1, 6.0)  # of the ego, to the middle of the adversary
LEFT_M = np.arange(-12.0, 12.1, 3.0)
YAWS_DEG = (15.0, 0.0, -15.0)

_ADVERSARY = 1
_CLEAR_M = 7.0  # none stands in the ego
_FACING_RAD = np.deg2rad(4.0)  # closer than that, corners of the boxes decide where the closest points are


@dataclass(frozen=True, eq=False)
class GradientField:
    """The effect of descent on an adversary turned by `yaw`: minus the gradient at each place."""

    yaw: float  # [rad] against the ego
    ahead: Float[np.ndarray, " place"]  # [m] from the ego's middle
    left: Float[np.ndarray, " place"]  # [m]
    accel: Float[np.ndarray, " place"]  # -dC/da [m / (m/s^2)]
    curvature: Float[np.ndarray, " place"]  # -dC/dk [m / (1/m)], positive: steers left

    @property
    def leads_away(self) -> Bool[np.ndarray, " place"]:
        """The places where the steering leads away from the ego's lane: ahead, to the side where it is or heads to."""
        side = np.where(self.left == 0.0, self.yaw, self.left)
        return (self.ahead > _CLEAR_M) & (self.curvature * side > 0.0)

    @property
    def converges(self) -> Bool[np.ndarray, " place"]:
        """The places where descent accelerates, and turns the heading to the ego unless it points there already."""
        off = wrap(np.arctan2(-self.left, -self.ahead) - self.yaw)
        return (self.accel > 0.0) & ((self.curvature * off > 0.0) | (np.abs(off) < _FACING_RAD))

    @property
    def behind(self) -> Bool[np.ndarray, " place"]:
        """The rear sector of rule 2."""
        return (self.ahead < 0.0) & (np.abs(np.arctan2(self.left, -self.ahead)) < 0.5 * REAR_SECTOR_RAD)

    @property
    def red(self) -> Bool[np.ndarray, " place"]:
        """The red zone of rule 1: bearing within pi/8 and between straight ahead and the heading."""
        return in_red_zone(self.ahead, self.left, self.yaw)


def in_red_zone(
    ahead: Float[np.ndarray, " place"], left: Float[np.ndarray, " place"], yaw: float
) -> Bool[np.ndarray, " place"]:
    """ReGentS rule 1 at one step, for an adversary turned by `yaw` [rad] at places relative to the ego [m]."""
    bearing, window = np.arctan2(left, ahead), FRONT_WINDOW_RAD
    return (abs(yaw) < window) & (np.abs(bearing) < window) & (bearing * yaw > 0.0) & (np.abs(bearing) < abs(yaw))


@in_float32
def gradient_field(yaw: float) -> GradientField:
    """The field for adversaries turned by `yaw` [rad] against the ego."""
    grid = np.meshgrid(AHEAD_M, LEFT_M)
    ahead, left = (values.ravel() for values in grid)
    clear = (np.abs(ahead) > _CLEAR_M) | (np.abs(left) > 0.5 * _CLEAR_M)
    ahead, left = ahead[clear], left[clear]
    places = (jnp.asarray(v, jnp.float32) for v in (ahead, left, np.full_like(ahead, yaw)))
    accel, curvature = _gradients(_two_cars(), *places)
    return GradientField(yaw, ahead, left, -np.asarray(accel, float), -np.asarray(curvature, float))


def _two_cars() -> World:
    """The ego and an adversary whose place is yet to be chosen, and whose distance counts at the last step only."""
    ego, adversary = Car(0.0, 0.0, SPEED_M_S), Car(20.0, 0.0, SPEED_M_S)
    world = to_world(traffic("two_cars", straight_road(1), ego, {"other": adversary}, HELD_S))
    return eqx.tree_at(lambda w: w.valid, world, world.valid.at[_ADVERSARY, :-1].set(False))


@compiled
def _gradients(
    world: World, ahead: Float[Array, " place"], left: Float[Array, " place"], yaw: Float[Array, " place"]
) -> tuple[Float[Array, " place"], Float[Array, " place"]]:
    """dC/da and dC/dk where the adversary ends at each place relative to the ego."""
    searched = SearchedAgents.only(_ADVERSARY, world.valid.shape[0])

    def cost(controls: tuple[Array, Array], place: tuple[Array, Array, Array]) -> Float[Array, ""]:
        placed = eqx.tree_at(lambda w: w.start, world, _start(world, place))
        steered = ControlArrays(
            world.controls.accel.at[_ADVERSARY].set(controls[0]),
            world.controls.curvature.at[_ADVERSARY].set(controls[1]),
        )
        return total_cost(placed, placed.boxes(roll_out_background(placed, steered)), searched, KING).ego

    straight_on = (jnp.float32(0.0), jnp.float32(0.0))
    return jax.vmap(lambda *place: jax.grad(cost)(straight_on, place))(ahead, left, yaw)


def _start(world: World, place: tuple[Array, Array, Array]) -> Motion:
    """The initial state from which an adversary ends at `place` (ahead, left, yaw) if it drives straight on."""
    ahead, left, yaw = place
    way, start = SPEED_M_S * HELD_S, world.start
    return Motion(
        start.x.at[_ADVERSARY].set(world.log.x[0, -1] + ahead - way * jnp.cos(yaw)),
        start.y.at[_ADVERSARY].set(world.log.y[0, -1] + left - way * jnp.sin(yaw)),
        start.yaw.at[_ADVERSARY].set(yaw),
        start.speed,
    )
