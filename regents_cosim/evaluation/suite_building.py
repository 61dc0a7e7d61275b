"""`regents suite build`: from traffic to a suite, by a recipe that gives the same suite every time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from regents_cosim.attacks.attack import attack_each
from regents_cosim.attacks.presets import METHODS
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.cards import Card, card
from regents_cosim.evaluation.curation import choose_adversarial, choose_ordinary
from regents_cosim.evaluation.driving import drive_each
from regents_cosim.files import content_hash
from regents_cosim.frames import wrap
from regents_cosim.scenario import AttackRecord, Scenario
from regents_cosim.shipped import network
from regents_cosim.sources.record import record
from regents_cosim.verdicts.judgement import judge_each

_SEEN_AHEAD_M = 40.0  # centre to centre
_IN_LANE_M = 1.6  # to either side: half a lane
_SAME_WAY_RAD = np.deg2rad(30.0)
_FOLLOWS_SHARE = 0.5  # of the horizon


@dataclass(frozen=True)
class Recipe:
    """Everything that decides which cases a suite holds."""

    nets: tuple[str, ...]  # shipped SUMO networks, or .sumocfg files
    highway: tuple[str, ...] = ()  # environments of highway-env
    windows: int = 25  # of traffic, for each of them
    adversarial: int = 80
    unavoidable: int = 5
    ordinary: int = 40
    planners: tuple[str, ...] = (
        "idm",
    )  # attacked in turn; the first has to drive the ordinary cases without collision
    method: str = "focused"
    seed: int = 0


def build(recipe: Recipe, tell: Callable[[str], None] = lambda line: None) -> list[Scenario]:
    """The cases of the suite, by name. Raises RegentsError where traffic cannot be recorded or no case is left."""
    windows = [scenario for source in _sources(recipe) for scenario in _recorded(source, recipe, tell)]
    crashes = _crashes(windows, recipe, tell)
    ordinary = _collision_free(windows, recipe)
    adversarial = choose_adversarial(_cards(crashes), recipe.adversarial, recipe.unavoidable, recipe.seed)
    followers = {scenario.id for scenario in ordinary if follows(scenario)}
    recorded = choose_ordinary(_cards(ordinary), followers, recipe.ordinary, recipe.seed)
    by_name = {scenario.id: scenario for scenario in (*crashes, *ordinary)}
    names = sorted(one.case for one in (*adversarial, *recorded))
    if not names:
        raise RegentsError("no case is left for the suite: ask for more --windows, or other traffic")
    telling = sum(one.telling is True for one in adversarial)
    found = f"{len(adversarial)} of {len(crashes)} crashes ({telling} telling)"
    tell(f"chosen: {found}, {len(recorded)} of {len(ordinary)} ordinary cases")
    return [_lean(by_name[name]) for name in names]


def follows(scenario: Scenario) -> bool:
    """Whether the ego drives behind somebody in its lane for half of the recording."""
    tracks = scenario.tracks
    dx, dy = tracks.x[1:] - tracks.x[0], tracks.y[1:] - tracks.y[0]
    cos, sin = np.cos(tracks.yaw[0]), np.sin(tracks.yaw[0])
    ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
    same_way = np.abs(wrap(tracks.yaw[1:] - tracks.yaw[0])) < _SAME_WAY_RAD
    leads = tracks.valid[1:] & same_way & (ahead > 0.0) & (ahead < _SEEN_AHEAD_M) & (np.abs(left) < _IN_LANE_M)
    return bool(leads.any(axis=0).mean() >= _FOLLOWS_SHARE)


def _sources(recipe: Recipe) -> list[Path | str]:
    return [*map(network, recipe.nets), *(f"highway:{environment}" for environment in recipe.highway)]


def _recorded(source: Path | str, recipe: Recipe, tell: Callable[[str], None]) -> list[Scenario]:
    tell(f"recording {source if isinstance(source, str) else source.stem}")
    return record(source, count=recipe.windows, seed=recipe.seed)


def _crashes(windows: Sequence[Scenario], recipe: Recipe, tell: Callable[[str], None]) -> list[Scenario]:
    found: list[Scenario] = []
    lost: list[AttackRecord] = []
    for planner in recipe.planners:
        for number, results in enumerate(attack_each(windows, METHODS[recipe.method], planner), start=1):
            found += [case for case in results if case.attack and case.attack.outcome == "collision"]
            lost += [case.attack for case in results if case.attack and case.attack.planner_error]
            if number % 25 == 0 or number == len(windows):
                tell(f"attacked {planner} in {number} of {len(windows)} windows: {len(found)} crashes")
    if lost:
        first = lost[0].planner_error.partition("\n")[0]
        tell(f"a planner failed in {len(lost)} windows, the first is {lost[0].case}: {first}")
    tell(f"judging {len(found)} crashes")
    return list(judge_each(found))


def _collision_free(windows: Sequence[Scenario], recipe: Recipe) -> list[Scenario]:
    """Those that the first planner drives without a collision: a test that it fails from the start teaches nothing."""
    drives = drive_each(windows, recipe.planners[0])
    return [scenario for scenario, drive in zip(windows, drives, strict=True) if not drive.error and drive.hits is None]


def _cards(scenarios: Sequence[Scenario]) -> list[Card]:
    return [card(scenario, content_hash(scenario)) for scenario in scenarios]


def _lean(scenario: Scenario) -> Scenario:
    """Without what no replay needs: the costs of every iteration, and what is never twice the same."""
    if scenario.attack is None:
        return scenario
    return replace(scenario, attack=replace(scenario.attack, cost_history={}, act_time=None))
