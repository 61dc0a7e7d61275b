"""The four failures of KING that the ReGentS paper names: a scene, the attacks on it, and what they show.

Nothing is staged: the scenes are recorded traffic to the attack, which runs with the presets of
the papers as they are, and with the cost of our own, against an ego that replays its log.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from benchmarks.focused_cost import FOCUSED_COST
from benchmarks.gallery import scenes
from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import KING, REGENTS, AttackConfig
from regents_cosim.geometry.boxes import Boxes, distance
from regents_cosim.scenario.scenario import Scenario

PLANNER = "log_replay"
METHOD_NAMES = {"king": "KING", "regents": "ReGentS", "focused": "focused"}


@dataclass(frozen=True, eq=False)
class Exhibit:
    """One failure of a method: its scene, and the attacks that show it."""

    name: str  # of its files
    title: str
    failure: str  # what goes wrong and why
    scenario: Scenario
    presets: tuple[AttackConfig, ...]
    watched: str  # id of the agent whose distance to the ego tells the story
    watched_name: str  # the same in words
    notes: dict[str, str]  # what to look for, per method, and in the log
    lesson: Callable[["ExhibitRun"], str]  # what the run shows, with its numbers
    seconds: tuple[float, float] = (0.0, scenes.HORIZON_S)  # that the picture shows


@dataclass(frozen=True, eq=False)
class ExhibitRun:
    """An exhibit and what the attacks made of it."""

    exhibit: Exhibit
    attacked: dict[str, Scenario]  # by method

    def gap(self, method: str | None = None, agent: str | None = None) -> Float[np.ndarray, " time"]:
        """Distance [m] of `agent`, by default the watched one, to the ego; without a method in the log."""
        scenario = self.attacked[method] if method else self.exhibit.scenario
        boxes = [np.broadcast_to(values, scenario.tracks.x.shape) for values in scenario.boxes]
        index = self.index(agent or self.exhibit.watched)
        return np.asarray(distance(Boxes(*(v[0] for v in boxes)), Boxes(*(v[index] for v in boxes))))

    def moved(self, method: str, agent: str) -> float:
        """How far the attack took an agent away from its log, at most [m]."""
        tracks, log, index = self.attacked[method].tracks, self.exhibit.scenario.tracks, self.index(agent)
        return float(np.hypot(tracks.x[index] - log.x[index], tracks.y[index] - log.y[index]).max())

    def turned_deg(self, method: str, agent: str) -> float:
        """Heading of an agent at the end, against the ego's road [degrees]."""
        return float(np.rad2deg(self.attacked[method].tracks.yaw[self.index(agent), -1]))

    def aside(self, agent: str, method: str | None = None) -> float:
        """How far to the left of the ego an agent ends [m]."""
        tracks = self.attacked[method].tracks if method else self.exhibit.scenario.tracks
        return float(tracks.y[self.index(agent), -1] - tracks.y[0, -1])

    def impact(self, method: str) -> float:
        """Relative speed at the collision [m/s], 0 where there is none."""
        record = self.attacked[method].attack
        return record.collision.relative_speed if record and record.collision else 0.0

    def iterations(self, method: str) -> int:
        """Updates that the attack made."""
        record = self.attacked[method].attack
        return record.iterations if record else 0

    def index(self, agent: str) -> int:
        """Row of an agent."""
        return self.exhibit.scenario.index(agent)


def run(exhibit: Exhibit) -> ExhibitRun:
    """Attack the scene of an exhibit with each of its presets; of several adversaries the first is shown."""
    return ExhibitRun(
        exhibit,
        {
            preset.method: next(attack([exhibit.scenario], preset, PLANNER, progress=False))
            for preset in exhibit.presets
        },
    )


def exhibits() -> tuple[Exhibit, ...]:
    """All of them, in the order of the gallery."""
    return _diverging_in_front(), _converging_behind(), _minimum_over_all(), _mean_over_time()


def _diverging_in_front() -> Exhibit:
    return Exhibit(
        "front_divergence",
        "Diverging in front",
        "An agent ahead of the ego that is offset and turned to the same side is pulled back by the gradient. "
        "The only steering that brings it nearer is to turn further away, until it stands across the road "
        "or has left it.",
        scenes.front_divergence(),
        (KING, REGENTS),
        "ahead",
        "the car ahead",
        {
            "log": "the car ahead changes lanes",
            "king": "steered away, further and further",
            "regents": "steering cancelled (rule 1): it brakes",
        },
        _front_divergence,
    )


def _converging_behind() -> Exhibit:
    return Exhibit(
        "rear_end",
        "Converging behind",
        "Behind the ego every gradient leads into its back. Such crashes come easily, are no fault of the ego, "
        "and tell nothing about its planner.",
        scenes.rear_end(),
        (KING, REGENTS),
        "follower",
        "the follower",
        {
            "log": "a follower, and a car ahead in the next lane",
            "king": "the follower is nearest, and accelerates",
            "regents": "no follower may attack (rule 2): the car ahead pulls in and brakes",
        },
        _rear_end,
    )


def _minimum_over_all() -> Exhibit:
    return Exhibit(
        "minimum_trap",
        "Minimum trap",
        "The cost is the minimum over all candidates, so only the nearest one gets a gradient. Where that one "
        "can never reach the ego, no other is tried.",
        scenes.minimum_trap(),
        (KING, REGENTS, FOCUSED_COST),
        "ahead",
        "the car ahead",
        {
            "log": "the neighbour behind the hedge is nearest",
            "king": "only the neighbour is pulled, and cannot come over",
            "regents": "the same: its rules do not help here",
            "focused": "the cost of our preset, each candidate searched alone: the car ahead pulls in and brakes",
        },
        _minimum_trap,
    )


def _mean_over_time() -> Exhibit:
    return Exhibit(
        "averaged_distance",
        "Time-averaged distance",
        "The cost is a mean over the whole horizon, so staying close for long counts for more than hitting once.",
        scenes.averaged_distance(),
        (KING, REGENTS, FOCUSED_COST),
        "cross",
        "the crossing car",
        {
            "log": "crosses just behind the ego",
            "king": "brakes: nearer on average, further away at best",
            "regents": "the same: its rules do not help here",
            "focused": "the cost of our preset, a soft minimum over time: accelerates",
        },
        _averaged_distance,
        seconds=(1.5, 5.0),
    )


# --- what the runs show -----------------------------------------------------------------------


def _front_divergence(run: ExhibitRun) -> str:
    log, king = run.aside("ahead"), run.aside("ahead", "king")
    return (
        f"In the log the car ahead changes lanes, turned by {run.turned_deg('regents', 'ahead'):.0f} degrees. "
        f"KING turns it to {run.turned_deg('king', 'ahead'):.0f} degrees, {king:.1f} m beside the ego's way "
        f"(log: {log:.1f} m), and misses after {run.iterations('king')} iterations, {run.gap('king').min():.1f} m "
        "away at best. ReGentS finds the car in the red zone of rule 1 and cancels its steering: left with the "
        f"brake, it stops where the ego still drives, and is hit at {run.impact('regents'):.1f} m/s after "
        f"{run.iterations('regents')} iterations."
    )


def _rear_end(run: ExhibitRun) -> str:
    return (
        f"KING takes the nearest agent, {run.gap().min():.0f} m behind, and accelerates it into the ego "
        f"({run.impact('king'):.1f} m/s, {run.iterations('king')} iterations). By rule 2 the follower is no candidate "
        f"for ReGentS. It takes the car ahead in the next lane, {run.gap(agent='ahead').min():.0f} m away, which pulls "
        f"in and brakes: the ego runs into it at {run.impact('regents'):.1f} m/s after {run.iterations('regents')} "
        "iterations."
    )


def _minimum_trap(run: ExhibitRun) -> str:
    return (
        f"The neighbour, {run.gap(agent='neighbour').min():.1f} m beside the ego behind a hedge, is nearer than the "
        f"car ahead ({run.gap().min():.0f} m) at every iteration. KING and ReGentS spend all "
        f"{run.iterations('king')} on it and leave the car ahead where it was (moved by "
        f"{run.moved('regents', 'ahead'):.2f} m): **ReGentS does not cure this**, its paper names it as a limit. Our "
        f"preset searches each candidate alone and finds the car ahead in {run.iterations('focused')} iterations."
    )


def _averaged_distance(run: ExhibitRun) -> str:
    log, king, focused = run.gap(), run.gap("king"), run.gap("focused")
    return (
        f"The crossing car passes behind the ego, {log.min():.1f} m away at best, {log.mean():.1f} m on average. KING "
        f"and ReGentS lower the average to {king.mean():.1f} m by braking, and come no "
        f"closer than {king.min():.1f} m: **ReGentS does not cure this**, its paper names it as a limit. The crash "
        "takes the opposite: accelerating. A soft minimum over time finds it in "
        f"{run.iterations('focused')} iterations, although the average rises to {focused.mean():.1f} m."
    )
