"""`regents suite build`: turns traffic into a suite, by a recipe that always gives the same suite.

The planners of a recipe form a ladder, the best first, with the careful driver (`--planner careful`) on top. A crash of
one of them is kept if all above it avoid it, so that it shows what this one lacks, and reveals when a better one gets
worse. Each crash is kept with its harmless neighbour (`evaluation.suites.harmless`), or left out if it has none.
"""

import hashlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from regents_cosim.attacks.methods.presets import AttackConfig, preset
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.shipped import network
from regents_cosim.cases.suite import CaseList
from regents_cosim.checks.arguments import as_several
from regents_cosim.checks.ranges import SEED, Range, check_ranges
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.drives.driving import DriveResult, drive_each
from regents_cosim.evaluation.suites.cards import CaseCard, card
from regents_cosim.evaluation.suites.folders import require_place, write_suite
from regents_cosim.evaluation.suites.harmless import harmless_neighbours
from regents_cosim.geometry.frames import ahead_and_left, wrap
from regents_cosim.norms.grades import Prevention
from regents_cosim.plain_text import all_named
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.replays.holds import verified_only
from regents_cosim.runs.steps import Steps
from regents_cosim.runs.traffic import traffic_digest
from regents_cosim.runs.window_job import AttackRun
from regents_cosim.scenario.road_users import RoadUser
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.short_repr import ShortRepr
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.sources.record import record
from regents_cosim.sources.windows import Prefer
from regents_cosim.system.progress import Progress, ShowProgress, progress_for

_SEEN_AHEAD_M = 40.0  # centre to centre
_IN_LANE_M = 1.6  # to either side: half a lane
_SAME_WAY_RAD = np.deg2rad(30.0)
_FOLLOWS_SHARE = 0.5  # of the horizon
_CAREFUL = "careful"  # top of every ladder
_BLIND = "constant_velocity"

_MOST = 1_000_000
_RANGES = {
    "windows": Range(1, _MOST, "windows of traffic, for each network and environment", whole=True),
    "attacked": Range(0, _MOST, "of these windows that are attacked; 0: all", whole=True),
    "adversarial": Range(0, _MOST, "crashes that a careful driver avoids", whole=True),
    "not_preventable": Range(0, _MOST, "crashes that it does not avoid", whole=True),
    "ordinary": Range(0, _MOST, "windows of recorded traffic", whole=True),
    "seed": SEED,
}


@dataclass(frozen=True, repr=False)
class Recipe(ShortRepr):
    """The parameters that determine the cases of a suite."""

    nets: tuple[str, ...] = ()  # shipped SUMO networks, or .sumocfg files
    highway: tuple[str, ...] = ()  # environments of highway-env
    windows: int = 25  # number of windows of traffic, for each network and environment
    attacked: int = 0  # number of these windows to attack; 0: all
    adversarial: int = 80  # number of crashes that a careful driver avoids
    not_preventable: int = 5  # number of crashes that a careful driver does not avoid
    ordinary: int = 40  # number of windows of recorded traffic
    harmless: bool = True  # only keep crashes that have a harmless neighbour, together with it
    planners: tuple[AnyPlanner, ...] = ("idm",)  # attacked in turn; the first is the best and passes the ordinary cases
    method: str = "focused"  # of the attack: focused, king or regents
    adversary_kinds: tuple[RoadUser, ...] | None = None  # kinds that may attack; None: those of the method
    prefer: Prefer = "conflicts"  # which windows come first
    seed: int = 0

    def __post_init__(self) -> None:
        """A single network, environment, planner or kind becomes a tuple of one. Raises RegentsError."""
        for name in ("nets", "highway", "planners", "adversary_kinds"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, as_several(given))
        check_ranges(self, _RANGES)
        _config(self)


def build_suite(output: Path | str, recipe: Recipe, *, progress: ShowProgress = True) -> CaseList:
    """Build the suite of `recipe` in the folder `output`, and return its cases.

    On the same machine the same recipe gives the same suite, bit for bit. A complete new suite replaces the content of
    the folder; its baseline stays. Until then the folder also keeps recorded windows and attacks, so that the same
    recipe can be continued. Progress is shown on terminals and in notebooks unless `progress` is False. Raises
    RegentsError if traffic cannot be recorded, no case is left, or `output` is a folder of something else.
    """
    folder = Path(output)
    require_place(folder)
    steps = Steps(folder)
    cases = _cases(recipe, steps, progress_for(progress))
    write_suite(folder, cases, recipe.seed)
    steps.clear()
    return CaseList(cases)


def _cases(recipe: Recipe, steps: Steps, progress: Progress) -> list[Scenario]:
    """The cases of the suite, by name; long steps continue from `steps`."""
    ladder = [PlannerUnderTest.of(one) for one in (_CAREFUL, *recipe.planners)]
    sources = [*map(network, recipe.nets), *(f"highway:{environment}" for environment in recipe.highway)]
    recorded_by_source = [_recorded(source, recipe, steps, progress) for source in sources]
    windows = [one for its in recorded_by_source for one in _spread(its, recipe.attacked)]
    crashes = list(verified_only(_crashes(windows, ladder, recipe, steps, progress)))
    # A test that the careful driver or the first planner fails from the start is useless.
    ordinary = _passed_by(ladder[:2], [one for its in recorded_by_source for one in its])
    neighbours = harmless_neighbours(crashes, ladder[0]) if recipe.harmless else {}
    met = [one for one in crashes if one.id in neighbours] if recipe.harmless else crashes
    adversarial = choose_adversarial(_cards(met), recipe.adversarial, recipe.not_preventable, recipe.seed)
    recorded = _chosen_ordinary(ordinary, recipe)
    by_name = {scenario.id: scenario for scenario in (*crashes, *ordinary)}
    chosen = [by_name[one.case] for one in (*adversarial, *recorded)]
    if not chosen:
        raise RegentsError("no case is left for the suite: ask for more --windows, or other traffic")
    beside = [neighbours[one.case] for one in adversarial] if recipe.harmless else []
    telling = sum(one.telling is True for one in adversarial)
    flawless = sum(one.flawless is True for one in adversarial)
    without = f", {len(crashes) - len(met)} have no harmless neighbour" if recipe.harmless else ""
    found = f"{len(adversarial)} of {len(crashes)} crashes ({telling} telling, {flawless} flawless{without})"
    progress.say(f"chosen: {found}, {len(recorded)} of {len(ordinary)} ordinary cases")
    return sorted(map(_lean, (*chosen, *beside)), key=lambda case: case.id)


def _spread(windows: Sequence[Scenario], count: int) -> Sequence[Scenario]:
    """`count` of the windows, evenly spaced; all where `count` is 0."""
    if not 0 < count < len(windows):
        return windows
    return [windows[number * len(windows) // count] for number in range(count)]


def _chosen_ordinary(ordinary: Sequence[Scenario], recipe: Recipe) -> list[CaseCard]:
    """The chosen ordinary cases: first those that demand something, because a blind planner crashes in them."""
    drives = drive_each(ordinary, _BLIND)
    asking = {scenario.id for scenario, drive in zip(ordinary, drives, strict=True) if not _passes(drive)}
    followers = {scenario.id for scenario in ordinary if follows(scenario)}
    cards = _cards(ordinary)
    first = choose_ordinary([c for c in cards if c.case in asking], followers, recipe.ordinary, recipe.seed)
    rest = [c for c in cards if c.case not in asking]
    return [*first, *choose_ordinary(rest, followers, recipe.ordinary - len(first), recipe.seed)]


def follows(scenario: Scenario) -> bool:
    """Whether the ego drives behind another vehicle in its lane for half of the recording."""
    tracks = scenario.tracks
    ahead, left = ahead_and_left(np, tracks.x[1:] - tracks.x[0], tracks.y[1:] - tracks.y[0], tracks.yaw[0])
    same_way = np.abs(wrap(tracks.yaw[1:] - tracks.yaw[0])) < _SAME_WAY_RAD
    leads = tracks.valid[1:] & same_way & (ahead > 0.0) & (ahead < _SEEN_AHEAD_M) & (np.abs(left) < _IN_LANE_M)
    return bool(leads.any(axis=0).mean() >= _FOLLOWS_SHARE)


def _recorded(source: Path | str, recipe: Recipe, steps: Steps, progress: Progress) -> list[Scenario]:
    progress.say(f"recording {source if isinstance(source, str) else source.stem}")
    windows = partial(record, source, count=recipe.windows, seed=recipe.seed, prefer=recipe.prefer, progress=False)
    settings = {"windows": recipe.windows, "seed": recipe.seed, "prefer": recipe.prefer}
    given = source if isinstance(source, str) else SumoInput(config=source)
    return steps.recorded(f"windows of {source}", settings, traffic_digest(given), windows)


def _crashes(
    windows: Sequence[Scenario], ladder: Sequence[PlannerUnderTest], recipe: Recipe, steps: Steps, progress: Progress
) -> list[Scenario]:
    kept: list[Scenario] = []
    for place, planner in enumerate(ladder[1:], 1):
        above = ladder[:place]
        kept += _passed_by(above, _found(windows, planner, recipe, steps, progress))
        names = all_named([one.name for one in above])
        progress.say(f"kept {len(kept)} crashes, which {names} pass{'es' if place == 1 else ''}")
    return kept


def _found(
    windows: Sequence[Scenario], planner: PlannerUnderTest, recipe: Recipe, steps: Steps, progress: Progress
) -> list[Scenario]:
    run = AttackRun(_config(recipe), planner, verify=False, pictures=False)
    runs = steps.attacked(f"{recipe.method} against {planner.name}", windows, run, progress)
    records = [case.attack for results in runs for case in results if case.attack]
    lost = [record for record in records if record.planner_error]
    if lost:
        first = lost[0].planner_error.partition("\n")[0]
        progress.say(f"a planner failed in {len(lost)} windows, the first is {lost[0].case}: {first}")
    return [case for results in runs for case in results if case.crash]


def _config(recipe: Recipe) -> AttackConfig:
    return preset(recipe.method, adversary_kinds=recipe.adversary_kinds)


def _passed_by(planners: Sequence[PlannerUnderTest], crashes: list[Scenario]) -> list[Scenario]:
    """The crashes that all of these planners avoid, and those that the careful driver of the verdict does not."""
    for planner in planners:
        drives = drive_each(crashes, planner)
        crashes = [
            case
            for case, drive in zip(crashes, drives, strict=True)
            if _passes(drive) or (case.judgement and case.judgement.prevention is Prevention.NOT_PREVENTABLE)
        ]
    return crashes


def _passes(drive: DriveResult) -> bool:
    return not drive.error and drive.hits is None


def _cards(scenarios: Sequence[Scenario]) -> list[CaseCard]:
    return [card(scenario, content_hash(scenario)) for scenario in scenarios]


def _lean(scenario: Scenario) -> Scenario:
    """The case without data that no replay needs: the costs of every iteration, and values that differ between runs."""
    if scenario.attack is None:
        return scenario
    return replace(scenario, attack=replace(scenario.attack, cost_history={}, act_time=None))


# Chooses the cases of a suite: balanced over collision types and networks, with few that are alike.
# Pure: the same cards, numbers and seed give the same choice, whatever the order of the cards.
_AVOIDED = (Prevention.PREVENTABLE, Prevention.BY_SWERVING)
_PER_WINDOW = 2  # attacks on one window share all their traffic but the adversary


def choose_adversarial(cards: Sequence[CaseCard], count: int, not_preventable: int, seed: int) -> list[CaseCard]:
    """`count` clean crashes that a careful driver avoids, and `not_preventable` ones that it does not.

    Telling ones are chosen before others. The choice is balanced over
    collision types, and within a type over networks. A window gives at most two cases, which differ in their adversary
    or their collision type. Sorted by name; fewer where there are not enough.
    """

    def clean(preventions: Collection[Prevention], most: int) -> list[CaseCard]:
        its = [card for card in cards if card.clean and card.prevention in preventions]
        return _balanced(its, most, seed, lambda card: card.collision_type)

    return _by_name([*clean(_AVOIDED, count), *clean((Prevention.NOT_PREVENTABLE,), not_preventable)])


def choose_ordinary(cards: Sequence[CaseCard], followers: Collection[str], count: int, seed: int) -> list[CaseCard]:
    """`count` cases of recorded traffic, half of them with the ego behind another vehicle (the names in `followers`).

    Those reveal a planner that keeps too little distance. Balanced over networks.
    """
    return _by_name(_balanced(cards, count, seed, lambda card: card.case in followers))


def _balanced(cards: Sequence[CaseCard], count: int, seed: int, trait: Callable[[CaseCard], object]) -> list[CaseCard]:
    """The next is telling while there are such, of the rarest trait so far, of its rarest network ..."""
    left = {card.case: card for card in cards}
    chosen: list[CaseCard] = []
    had: Counter[object] = Counter()
    alike: set[tuple[object, ...]] = set()

    def traits(card: CaseCard) -> list[tuple[object, ...]]:
        cell = ("cell", trait(card), card.network)
        return [("trait", trait(card)), cell, ("by", card.planner), ("net", card.network), ("window", card.window)]

    def rarity(card: CaseCard) -> tuple[int | str, ...]:
        lot = hashlib.sha256(f"{seed} {card.case}".encode()).hexdigest()  # unbiased towards early windows
        return int(card.telling is not True), *(had[one] for one in traits(card)), lot

    while left and len(chosen) < count:
        card = left.pop(min(left.values(), key=rarity).case)
        likeness = (card.window, card.adversary, card.collision_type)
        if likeness in alike or had["window", card.window] >= _PER_WINDOW:
            continue
        alike.add(likeness)
        had.update(traits(card))
        chosen.append(card)
    return chosen


def _by_name(cards: Iterable[CaseCard]) -> list[CaseCard]:
    return sorted(cards, key=lambda card: card.case)
