"""Compares a replay with its case, by exact boxes, to tell whether the crash happens in the simulator as well."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.errors import DriveError, PlannerError, RegentsError
from regents_cosim.geometry.frames import wrap
from regents_cosim.planners.interface import Debug, DebugSteps
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.short_repr import ShortRepr

POSITION_BOUND_M = 1e-3
YAW_BOUND_DEG = 0.01
THOUGHTS_KEPT_S = 2.0  # how long before a crash it is kept what the planner thought
TOLERANCE_S = 1.0  # in live traffic the collision may be earlier or later by this

Contact = tuple[str, int]  # agent id, step


class ReportedCollision(NamedTuple):
    """A collision as a simulator reports it."""

    step: int
    collider: str  # agent id
    victim: str  # agent id
    type: str  # the simulator's word: "collision", "junction", "frontal", ... in SUMO, "crashed" in highway-env


@dataclass(frozen=True, eq=False, repr=False)
class Replay(ShortRepr):
    """The result of replaying a case in a simulator.

    `verified`: the first contact of the ego is the same as in the case, or both have none; see `compare`. Errors are
    those of scripted agents, 0 for all others and where absent.
    """

    case: str
    verified: bool
    reason: str  # why it is not verified
    expected: Contact | None = None
    found: Contact | None = None
    position_error_m: Float[np.ndarray, "agent time"] | None = None
    yaw_error_deg: Float[np.ndarray, "agent time"] | None = None
    own_collisions: tuple[ReportedCollision, ...] = ()  # the simulator's own list
    replayed: Scenario | None = None  # with the tracks that the simulator reported
    intended: Tracks | None = None  # the tracks of the case
    driven: tuple[str, ...] = ()  # agents that the simulator drove
    unmatched: tuple[str, ...] = ()  # agents that it should have driven, but that have no route: they stayed on track
    as_vehicles: tuple[str, ...] = ()  # pedestrians that were vehicles in SUMO, for which its drivers brake
    planner_failed: bool = False  # the planner is the reason
    trace: str = ""  # traceback of a planner that failed
    debug: DebugSteps = ()  # what a planner outside the loop thought before its crash, by step

    @property
    def reports_same_pair(self) -> bool:
        """Whether the simulator's own list contains the ego with the agent that it hits in the case."""
        if self.expected is None or self.replayed is None:
            return False
        pair = {self.expected[0], self.replayed.ego.id}
        return any({hit.collider, hit.victim} == pair for hit in self.own_collisions)

    @property
    def shift_m(self) -> float | None:
        """The distance between the collision in the case and in the replay [m]: the ego's or the other's, the greater.

        It is measured from the positions in the case at its first contact to those in the replay at its own; None
        unless both have one, with the same agent.
        """
        if self.expected is None or self.found is None or self.replayed is None or self.found[0] != self.expected[0]:
            return None
        assert self.intended is not None
        pair = [0, self.replayed.index(self.found[0])]
        was, now = self.intended, self.replayed.tracks
        (_, step), (_, found) = self.expected, self.found
        return float(np.hypot(now.x[pair, found] - was.x[pair, step], now.y[pair, found] - was.y[pair, step]).max())


def compare(
    scenario: Scenario,
    tracks: Tracks,
    own_collisions: tuple[ReportedCollision, ...] = (),
    ego_is_free: bool = False,
    driven: Collection[int] = (),
) -> Replay:
    """Compare `tracks`, as a simulator reported them, with the case.

    Scripted agents must be present at every step, within 1 mm and 0.01 degrees of their tracks. All agents are scripted
    but the ego where a planner drove it (`ego_is_free`) and those that the simulator drove (`driven`, by index). The
    first contact must be with the same agent at the same step, or within 1 s of it where the simulator drove any agent.
    """
    scripted = np.array([not (index in driven or (ego_is_free and index == 0)) for index in range(len(tracks.x))])
    position = np.hypot(tracks.x - scenario.tracks.x, tracks.y - scenario.tracks.y)
    yaw = np.abs(np.rad2deg(wrap(tracks.yaw - scenario.tracks.yaw)))
    judged = scenario.tracks.valid & tracks.valid & scripted[:, None]
    position, yaw = (np.where(judged, error, 0.0) for error in (position, yaw))
    expected, found = (_contact(scenario, motion) for motion in (scenario.tracks, tracks))
    off = _absent(scenario, tracks, scripted) or _worst(scenario, position, yaw)
    tolerance = round(TOLERANCE_S / scenario.dt) if driven else 0
    reason = _stale(scenario, expected) or _difference(expected, found, off, tolerance)
    return Replay(
        case=scenario.id,
        verified=not reason,
        reason=reason,
        expected=expected,
        found=found,
        position_error_m=position,
        yaw_error_deg=yaw,
        own_collisions=own_collisions,
        replayed=replace(scenario, tracks=tracks),
        intended=scenario.tracks,
        driven=tuple(scenario.agents[index].id for index in sorted(driven)),
    )


def before_crash(scenario: Scenario, tracks: Tracks, thoughts: Mapping[int, Debug]) -> DebugSteps:
    """What was thought in the last seconds before the ego's first contact; nothing without one."""
    contact = first_contact(scenario.agents, tracks) if thoughts else None
    if contact is None:
        return ()
    first = contact[1] - round(THOUGHTS_KEPT_S / scenario.dt)
    return tuple((step, one) for step, one in sorted(thoughts.items()) if first <= step <= contact[1])


def failed(scenario: Scenario, error: RegentsError) -> Replay:
    """The result for a replay that could not be made."""
    return Replay(
        scenario.id,
        verified=False,
        reason=str(error),
        expected=_contact(scenario, scenario.tracks),
        planner_failed=isinstance(error, PlannerError),
        trace=error.trace if isinstance(error, DriveError) else "",
    )


def _contact(scenario: Scenario, tracks: Tracks) -> Contact | None:
    contact = first_contact(scenario.agents, tracks)
    return contact and (scenario.agents[contact[0]].id, contact[1])


def _stale(scenario: Scenario, expected: Contact | None) -> str:
    """A message if the collision that an attack has noted (or none) is not the one of the case's tracks; else empty."""
    noted = scenario.collision
    says_none = scenario.attack is not None and scenario.attack.outcome == "no_collision"
    if (noted is None and not (says_none and expected)) or (noted and (noted.agent, noted.step) == expected):
        return ""
    said = f"a collision with {noted.agent} at step {noted.step}" if noted else "no collision"
    shown = f"one with {expected[0]} at step {expected[1]}" if expected else "none"
    return f"the case notes {said}, its own tracks show {shown}"


def _absent(scenario: Scenario, tracks: Tracks, scripted: Bool[np.ndarray, " agent"]) -> str:
    """A message about the first agent that is present in the case but not in the replay; else empty."""
    missing = np.argwhere((scenario.tracks.valid & ~tracks.valid & scripted[:, None]).T)
    return f"{scenario.agents[missing[0][1]].id} is not there at step {missing[0][0]}" if len(missing) else ""


def _worst(scenario: Scenario, position: np.ndarray, yaw: np.ndarray) -> str:
    """A message about the agent that is farthest off, if it exceeds the bounds; else empty."""
    if position.max(initial=0.0) <= POSITION_BOUND_M and yaw.max(initial=0.0) <= YAW_BOUND_DEG:
        return ""
    error = np.maximum(position / POSITION_BOUND_M, yaw / YAW_BOUND_DEG)
    agent, step = np.unravel_index(np.argmax(error), error.shape)
    name = scenario.agents[agent].id
    return f"{name} is off by {1e3 * position[agent, step]:.3g} mm and {yaw[agent, step]:.3g} degrees at step {step}"


def _difference(expected: Contact | None, found: Contact | None, off: str, tolerance: int) -> str:
    if expected == found or (
        expected and found and expected[0] == found[0] and abs(expected[1] - found[1]) <= tolerance
    ):
        return off
    if found is None:
        return f"no collision, expected one with {expected[0]} at step {expected[1]}" if expected else off
    said = f"collision with {found[0]} at step {found[1]}"
    within = f", at most {tolerance} steps earlier or later" if expected and tolerance else ""
    return f"{said}, expected {f'{expected[0]} at step {expected[1]}' if expected else 'none'}{within}"
