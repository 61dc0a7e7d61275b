"""Find collisions in tracks with exact boxes: which agents touch, when, and how they meet."""

import itertools
from typing import Literal

import numpy as np
from jaxtyping import Bool, Int

from regents_cosim.geometry.boxes import Boxes, in_between, overlap, there_between
from regents_cosim.geometry.frames import ahead_and_left, wrap
from regents_cosim.geometry.lines import steps_along
from regents_cosim.norms import clean
from regents_cosim.norms.limits import AGAINST_RAD, ALONG_RAD
from regents_cosim.scenario.attack_record import Collision, CollisionType
from regents_cosim.scenario.scenario import VEHICLE_KINDS, Agent, Overlap, Scenario, Tracks, boxes_of


def ego_contacts(agents: tuple[Agent, ...], tracks: Tracks) -> Bool[np.ndarray, "agent time"]:
    """Where each agent's box touches the ego's box; row 0, the ego itself, is all False.

    An agent whose box overlaps the ego's when it first appears is left out: real logs hold such pairs, and neither
    drove into the other. Source: ReGentS eq. 2.
    """
    boxes = boxes_of(agents, tracks)
    hits = overlap(boxes.at(0), boxes) & tracks.valid & tracks.valid[:1]
    hits[~_clear_at_entry(tracks, hits)] = False
    return hits


def apart_at_entry(agents: tuple[Agent, ...], tracks: Tracks) -> Bool[np.ndarray, " agent"]:
    """The agents that can collide with the ego: all others, unless they overlap it when they first appear."""
    boxes = boxes_of(agents, tracks)
    return _clear_at_entry(tracks, np.asarray(overlap(boxes.at(0), boxes)))


def _clear_at_entry(tracks: Tracks, hits: Bool[np.ndarray, "agent time"]) -> Bool[np.ndarray, " agent"]:
    clear = ~hits[np.arange(len(hits)), np.argmax(tracks.valid, axis=1)]
    clear[0] = False
    return clear


def first_contact(agents: tuple[Agent, ...], tracks: Tracks) -> tuple[int, int] | None:
    """The ego's first collision as (agent index, step), or None; the least index where several touch at once."""
    hits = ego_contacts(agents, tracks)
    steps = np.flatnonzero(hits.any(axis=0))
    if not len(steps):
        return None
    return int(np.argmax(hits[:, steps[0]])), int(steps[0])


def collision_at(
    agents: tuple[Agent, ...], tracks: Tracks, contact: tuple[int, int], dt: float, attributed: bool
) -> Collision:
    """The ego's collision at a `contact` (agent index, step); `attributed` says whether the attack moved that agent."""
    agent, step = contact
    return Collision(
        agent=agents[agent].id,
        step=step,
        time_s=round(step * dt, 9),
        collision_type=collision_type_of(agents, tracks, agent, step),
        relative_speed=relative_speed(tracks, agent, step),
        attributed=attributed,
    )


def collision_type_of(agents: tuple[Agent, ...], tracks: Tracks, agent: int, step: int) -> CollisionType:
    """How the ego and `agent` met at `step`, from their headings and from the gap one step before.

    Headings within 45 degrees run the same way: the collision is a rear-end one if the gap was lengthwise just before,
    and a side-swipe otherwise. Headings more than 135 degrees apart make it head-on, those in between a T-bone. For a
    pedestrian only the face of the ego counts.
    """
    if agents[agent].kind == "pedestrian":
        return _OF_PERSON[met_face(agents, tracks, agent, step)]
    turn = abs(float(wrap(tracks.yaw[agent, step] - tracks.yaw[0, step])))
    if turn > AGAINST_RAD:
        return "head_on"
    if turn > ALONG_RAD:
        return "t_bone"
    before = _last_steps(tracks, agent, step)[0]
    dx, dy = (values[agent, before] - values[0, before] for values in (tracks.x, tracks.y))
    ahead, left = ahead_and_left(np, dx, dy, tracks.yaw[0, before])
    ego, other = agents[0], agents[agent]
    gap_along = abs(ahead) - 0.5 * (ego.length + other.length)
    gap_across = abs(left) - 0.5 * (ego.width + other.width)
    if gap_across > gap_along:
        return "side_swipe"
    return "rear_end_by_ego" if ahead > 0 else "rear_end_by_adversary"


Face = Literal["front", "side", "rear"]
_OF_PERSON: dict[Face, CollisionType] = {
    "front": "person_by_front",
    "side": "person_by_side",
    "rear": "rear_end_by_adversary",
}


def met_face(agents: tuple[Agent, ...], tracks: Tracks, agent: int, step: int) -> Face:
    """The face of the ego that `agent` meets at the first `step` of contact (`norms.clean.met_face`)."""
    length, width = np.array([(one.length, one.width) for one in (agents[0], agents[agent])]).T
    aside, front = clean.met_face(np, *_last_poses(tracks, agent, step), 0.5 * length, 0.5 * width)
    if aside:
        return "side"
    return "front" if front else "rear"


def runs_into_side(agents: tuple[Agent, ...], tracks: Tracks, agent: int, step: int, dt: float) -> bool:
    """Whether `agent` meets a side of the ego and closes the gap by itself (`norms.clean.closes_in`)."""
    aside = met_face(agents, tracks, agent, step) == "side"
    return aside and bool(clean.closes_in(np, *_last_poses(tracks, agent, step), dt))


def _last_steps(tracks: Tracks, agent: int, step: int) -> Int[np.ndarray, " 2"]:
    return clean.last_step(np, tracks.valid[[0, agent]].all(axis=0), step)


def _last_poses(tracks: Tracks, agent: int, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """X, y [m], cosine and sine of the yaw of the ego and `agent` [2, 2] at the steps that lead to `step`."""
    at = np.ix_(np.array((0, agent)), _last_steps(tracks, agent, step))
    return tracks.x[at], tracks.y[at], np.cos(tracks.yaw[at]), np.sin(tracks.yaw[at])


def relative_speed(tracks: Tracks, agent: int, step: int) -> float:
    """Magnitude of the difference of the velocities of the ego and `agent` [m/s]."""
    velocity = tracks.speed[[0, agent], step] * np.exp(1j * tracks.yaw[[0, agent], step])
    return float(abs(velocity[1] - velocity[0]))


def collision_of_drive(case: Scenario, tracks: Tracks) -> Collision | None:
    """The first collision of the ego of a case that gave `tracks`; None where it has none."""
    contact = first_contact(case.agents, tracks)
    if contact is None:
        return None
    return collision_at(case.agents, tracks, contact, case.dt, case.agents[contact[0]].role == "adversary")


def find_overlaps(agents: tuple[Agent, ...], tracks: Tracks) -> tuple[Overlap, ...]:
    """Every pair of agents whose boxes overlap at some step, with the first and last step of the overlap."""
    boxes = boxes_of(agents, tracks)
    found = []
    for i, j in itertools.combinations(range(len(agents)), 2):
        reach = 0.5 * (np.hypot(agents[i].length, agents[i].width) + np.hypot(agents[j].length, agents[j].width))
        both = tracks.valid[i] & tracks.valid[j]
        close = both & (np.hypot(tracks.x[i] - tracks.x[j], tracks.y[i] - tracks.y[j]) <= reach)
        if close.any():
            steps = np.flatnonzero(close & overlap(boxes.at(i), boxes.at(j)))
            if len(steps):
                found.append(Overlap((agents[i].id, agents[j].id), int(steps[0]), int(steps[-1])))
    return tuple(found)


def collides_since(scenario: Scenario) -> Int[np.ndarray, " agent"]:
    """The step from which on each agent is in a collision of the recorded traffic; the number of steps if it never is.

    Two collide that overlap but did not when both first appeared, and of which at least one is a motor vehicle.
    """
    valid, since = scenario.recorded_tracks.valid, np.full(len(scenario.agents), scenario.tracks.steps)
    for pair in scenario.overlaps:
        two = [scenario.index(name) for name in pair.agents]
        began_apart = pair.first_step > np.argmax(valid[two].all(axis=0))
        if began_apart and any(scenario.agents[one].kind in VEHICLE_KINDS for one in two):
            since[two] = np.minimum(since[two], pair.first_step)
    return since


def touching(boxes: Boxes, valid: Bool[np.ndarray, "agent time"], parts: int) -> Bool[np.ndarray, "agent agent"]:
    """Which pairs of agents touch at a step or at one of `parts` - 1 instants between; boxes are [agent time].

    Every agent touches itself. Circles around the boxes find the pairs that need the exact test.
    """
    found = np.eye(len(valid), dtype=bool)
    pairs = np.stack(np.nonzero(np.triu(_near(boxes, valid), k=1)))
    finer, there = in_between(boxes, parts), there_between(valid, parts)
    for first in range(0, pairs.shape[1], _PAIRS_AT_ONCE):
        i, j = pairs[:, first : first + _PAIRS_AT_ONCE]
        mine, theirs = finer.at(i), finer.at(j)
        found[i, j] = np.any(overlap(mine, theirs) & there[i] & there[j], axis=1)
    return found | found.T


_PAIRS_AT_ONCE = 1000


def _near(boxes: Boxes, valid: Bool[np.ndarray, "agent time"]) -> Bool[np.ndarray, "agent agent"]:
    """Which pairs may touch: those whose circles, grown by the way of half a step, overlap."""
    x, y, length, width = (np.broadcast_to(v, valid.shape) for v in (boxes.x, boxes.y, boxes.length, boxes.width))
    both = valid[:, :-1] & valid[:, 1:]
    ways = np.where(both, steps_along(x, y), 0.0)
    reach = 0.5 * (np.hypot(length, width)[:, 0] + ways.max(axis=1, initial=0.0))
    near = np.zeros((len(x), len(x)), bool)
    for agent in range(len(x) - 1):
        others = slice(agent + 1, None)
        away = np.hypot(x[others] - x[agent], y[others] - y[agent])
        near[agent, others] = np.any(
            valid[others] & valid[agent] & (away <= (reach[others] + reach[agent])[:, None]), axis=1
        )
    return near
