"""The careful driver's drive that avoids a crash: as a case to be replayed and learned from, and the room it keeps."""

from dataclasses import fields, replace

import numpy as np
from jaxtyping import Float

from regents_cosim.errors import ScenarioError
from regents_cosim.geometry.boxes import distance
from regents_cosim.scenario.collisions import ego_contacts
from regents_cosim.scenario.scenario import Agent, Scenario, Tracks, boxes_of


def evaded(attacked: Scenario) -> Scenario:
    """The attacked scenario with the careful driver as the ego, which avoids the collision; others move as before.

    Followers that would run into the ego's back are left out, since their tracks do not brake. The attack then counts
    as one that found no collision, as a replay expects. Raises ScenarioError where that drive is not known.
    """
    if attacked.evasion is None or attacked.attack is None:
        raise ScenarioError(f"case {attacked.id} has no evasion, expected a collision that a careful driver avoids")
    attack = replace(attacked.attack, outcome="no_collision", collision=None)
    driven = replace(attacked, tracks=_with_ego(attacked.tracks, attacked.evasion), attack=attack)
    free = np.logical_not(np.any(ego_contacts(driven.agents, driven.tracks), axis=1))
    if free.all():
        return driven
    return replace(driven.keeping(free), judgement=attacked.judgement, evasion=attacked.evasion)


def _with_ego(tracks: Tracks, ego: Tracks) -> Tracks:
    """`tracks` with the ego's row replaced by `ego` [1, time]; controls only where both have them."""
    joined = {}
    for name in (f.name for f in fields(Tracks)):
        own, all_ = getattr(ego, name), getattr(tracks, name)
        joined[name] = None if own is None or all_ is None else np.concatenate([own, all_[1:]])
    return Tracks(**joined)


def room_m(scenario: Scenario) -> float | None:
    """The least distance [m] of the careful driver, once it acts, to what the ego hits; None where it is not known."""
    drive, since, tracks = scenario.evasion, scenario.evades_from, scenario.tracks
    met = scenario.index(scenario.collision.agent) if scenario.collision else scenario.adversary
    if drive is None or met is None:
        return None
    apart = gaps_m(scenario.agents, drive, tracks, met)
    least = np.where(tracks.valid[met], apart, np.inf)[since:].min()
    return float(least) if np.isfinite(least) else None


def gaps_m(agents: tuple[Agent, ...], ego: Tracks, others: Tracks, other: int) -> Float[np.ndarray, " step"]:
    """The distances [m] of the bodies of the ego, along its own tracks, and of one of the others, along theirs."""
    return np.asarray(distance(boxes_of(agents[:1], ego).at(0), boxes_of(agents, others).at(other)))
