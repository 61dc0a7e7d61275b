"""`regents suite`: builds, lists, checks, judges and merges suites."""

import dataclasses
from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App

from regents_cosim.cli.groups import Advanced, OfOutput, OfPlanner, OfSearch, OfTraffic
from regents_cosim.cli.options import (
    ActTimeout,
    AskedFor,
    Count,
    CountOrZero,
    Output,
    OutputIfAny,
    OutputOptions,
    Seed,
    SettingsFile,
    SuiteFolder,
    Switch,
)
from regents_cosim.cli.shared import open_terminal, words_in
from regents_cosim.errors import NEGATIVE_VERDICT, PLANNER_FAILED, RegentsError
from regents_cosim.plain_text import counted, listed
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S

if TYPE_CHECKING:
    from regents_cosim.evaluation.suites.cards import CaseCard

_NAMED = 10  # most foreign files named

suites = App(name="suite", help="Build, list, check and merge suites: folders of cases on which planners are tested.")


@suites.command
def build(
    *,
    output: Output,
    nets: Annotated[str, OfTraffic] = "all",
    highway: Annotated[str, OfTraffic] = "",
    windows: Annotated[Count, OfTraffic] = 25,
    attacked: Annotated[CountOrZero, Advanced] = 0,
    adversarial: Annotated[CountOrZero, OfOutput] = 80,
    not_preventable: Annotated[CountOrZero, OfOutput] = 5,
    ordinary: Annotated[CountOrZero, OfOutput] = 40,
    harmless: Annotated[Switch, OfOutput] = True,
    planner: Annotated[tuple[str, ...], OfPlanner] = ("idm",),
    method: Annotated[Literal["regents", "king", "focused"], OfSearch] = "focused",
    adversary_kinds: Annotated[str | None, Advanced] = None,
    prefer: Annotated[Literal["conflicts", "pedestrians", "none"], Advanced] = "conflicts",
    seed: Annotated[Seed, OfTraffic] = 0,
    settings: SettingsFile = None,
    talk: OutputOptions = OutputOptions(),
    asked: AskedFor,
) -> int:
    """Record traffic, attack it, and keep a balanced choice.

    On the same machine the same command gives the same suite, bit for bit. A complete new suite replaces the content of
    the folder; its baseline stays.

    Parameters
    ----------
    output
        folder for the suite
    nets
        SUMO networks, separated by commas: all (merge, crossing, signals, roundabout, grid and multilane), none, names
        of shipped networks, or .sumocfg files
    highway
        environments of highway-env, separated by commas, e.g. merge-v1,roundabout-v1
    windows
        number of windows of traffic from each network and environment
    attacked
        number of these windows that are attacked, evenly spaced; 0: all. The others only provide ordinary cases, which
        saves time
    adversarial
        number of clean crashes that a careful driver avoids, balanced over collision types and networks; telling ones
        come first
    not_preventable
        number of clean crashes that a careful driver does not avoid
    ordinary
        number of ordinary cases: windows of recorded traffic in which the planner and the careful driver do not
        collide; windows in which constant_velocity collides come first, and in half of them the ego follows another
        vehicle
    harmless
        only keep crashes that have a harmless neighbour, together with it: the same scene with so little of the attack
        left that a careful driver keeps 1 m from all others, brakes by at most 3 m/s^2 and makes progress. A planner
        that always brakes fails to make progress there
    planner
        planner that is attacked; may be repeated, the best first. A crash is kept if the careful driver and all earlier
        planners avoid it: crashes of a bad planner are near misses of a good planner, and show when that gets worse.
        The first planner has to drive the ordinary cases without a collision
    method
        method of the attack
    adversary_kinds
        kinds of road users that may attack, separated by commas: vehicle, cyclist, pedestrian (default of focused: all;
        of king and regents: vehicle)
    prefer
        which windows come first: conflicts: those where another road user can lawfully cross or join the ego's path,
        led by those in which the ego has to give way to it;
        pedestrians: those where a pedestrian can; none: no preference
    seed
        random seed of the traffic and of the choice
    """
    from regents_cosim.attacks.methods.presets import road_users
    from regents_cosim.cases.shipped import NETWORKS
    from regents_cosim.evaluation.suites.building import Recipe, build_suite
    from regents_cosim.evaluation.suites.cards import card_of
    from regents_cosim.reports.tables import LISTED

    terminal = open_terminal(talk)
    networks = NETWORKS if nets == "all" else () if nets == "none" else words_in(nets)
    recipe = Recipe(
        networks, words_in(highway), windows=windows, adversarial=adversarial, not_preventable=not_preventable,
        ordinary=ordinary, attacked=attacked, harmless=harmless, planners=planner, method=method,
        adversary_kinds=None if adversary_kinds is None else road_users(adversary_kinds), prefer=prefer, seed=seed,
    )  # fmt: skip
    scenarios = build_suite(output, recipe, progress=terminal)
    asked.keep(output)
    terminal.show(
        f"{counted(len(scenarios), 'case')} in {output}",
        _rows(card_of(output / s.id) for s in scenarios),
        essential=LISTED,
    )
    terminal.suggest(("regents", "evaluate", output, "--planner", planner[0]))
    return 0


@suites.command(name="list")
def list_cases(
    suite: SuiteFolder | None = None,
    *,
    tag: tuple[str, ...] = (),
    shipped: bool = False,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """List the cases of a suite.

    Parameters
    ----------
    tag
        only cases with this tag, e.g. cut_in or junction (an unknown one lists all); may be repeated: then with all
        these
    shipped
        list the suites and SUMO networks that come with the package instead
    """
    from regents_cosim.cases.suite import suite_cases
    from regents_cosim.evaluation.suites.cards import tagged_card_of
    from regents_cosim.reports.tables import LISTED, shipped_rows
    from regents_cosim.tags.table import require_tags

    if shipped == (suite is not None):
        raise RegentsError("expected a folder of cases, or --shipped for those that come with the package")
    terminal = open_terminal(talk)
    if suite is None:
        terminal.show("they come with regents_cosim", shipped_rows())
        return 0
    require_tags(tag)
    cards = [tagged_card_of(suite / case) for case in suite_cases(suite)]
    rows = _rows((card for card in cards if card.is_tagged(tag)), short=not talk.json)
    of = f" of {len(cards)}" if tag else ""
    terminal.show(f"{len(rows)}{of} cases in {suite}", rows, essential=LISTED)
    return 0


def _rows(cards: "Iterable[CaseCard]", short: bool = True) -> list[dict[str, Any]]:
    """A table row for each case, with a short hash for people."""
    return [dataclasses.asdict(card) | ({"hash": card.hash[:12]} if short else {}) for card in cards]


@suites.command
def coverage(suite: SuiteFolder, *, talk: OutputOptions = OutputOptions()) -> int:
    """Show which cells of the map of behaviours the crashes of a suite fill, and the best crash of each."""
    from regents_cosim.cases.suite import suite_cases
    from regents_cosim.reports.tables import COVERED, coverage_map
    from regents_cosim.runs.behaviour_map import NAMES, archive_of

    terminal = open_terminal(talk)
    with terminal.waiting("reading"):
        found = archive_of(suite / case for case in suite_cases(suite))
    plain = found.to_dict()
    if talk.json:
        terminal.publish("", {"suite": str(suite), **plain})
        return 0
    terminal.write(coverage_map(found))
    terminal.show(f"the crashes of {suite}", plain["elites"], found.summary(), (*NAMES, *COVERED))
    return 0


@suites.command
def check(suite: SuiteFolder, *, replay: bool = False, talk: OutputOptions = OutputOptions()) -> int:
    """Check that every case of a suite loads unchanged, with its maps, and fits its manifest and its baseline.

    Files that do not belong to the suite are listed.

    Parameters
    ----------
    replay
        also replay every case in the simulator that recorded it, and compare every position
    """
    from regents_cosim.evaluation.suites.folders import check_suite, strangers_in
    from regents_cosim.planners.names import is_built_in
    from regents_cosim.reports.tables import CHECKED

    terminal = open_terminal(talk)
    with terminal.waiting("checking"):
        rows = list(check_suite(suite, replay))
    bad = [row for row in rows if row.problem]
    foreign = sorted({row.planner for row in rows if row.planner and not is_built_in(row.planner)})
    if foreign:
        terminal.say(
            f"attacked with planners that do not come with regents_cosim: {', '.join(foreign)} "
            "(a planner that a case names is not run, only one that you name with --planner)"
        )
    if strange := [str(path) for path in strangers_in(suite)]:
        terminal.say(f"in the folder, but not part of the suite: {listed(strange, _NAMED)} (never run or read)")
    terminal.show(
        f"{counted(len(rows), 'case')} checked in {suite}, {len(bad)} with a problem",
        [dataclasses.asdict(row) for row in (rows if talk.json else bad)],
        essential=CHECKED,
    )
    return NEGATIVE_VERDICT if bad else 0


@suites.command
def judge(suite: SuiteFolder, *, output: OutputIfAny = None, talk: OutputOptions = OutputOptions()) -> int:
    """Judge the crashes of a suite again by the current rules: which of them are telling.

    Without this command a case keeps the judgement with which it was made. Outcomes accepted in the suite's baseline
    stay accepted.

    Parameters
    ----------
    output
        folder for the newly judged cases; by default the suite itself
    """
    from regents_cosim.cases.files import STILL
    from regents_cosim.cases.shipped import require_own
    from regents_cosim.evaluation.suites.folders import judge_into
    from regents_cosim.reports.picture import draw_into_case
    from regents_cosim.reports.tables import JUDGED, judged_row, summary

    terminal = open_terminal(talk)
    folder = output or suite
    require_own(folder, "--output")
    drawn = {still.parent.name for still in suite.glob(f"*/{STILL}")}
    judged = judge_into(folder, suite, terminal)
    for _, case in terminal.each([pair for pair in judged if pair[1].id in drawn], "drawing", len(drawn)):
        draw_into_case(case, folder)
    crashes = [pair for pair in judged if pair[1].judgement]
    rows = [judged_row(before, after) for before, after in crashes]
    note = summary([after for _, after in judged], {})
    terminal.show(
        f"{counted(len(rows), 'crash')} judged, of {counted(len(judged), 'case')} in {folder}", rows, note, JUDGED
    )
    return 0


@suites.command
def rank(
    suite: SuiteFolder,
    *,
    planner: tuple[str, ...],
    act_timeout: ActTimeout = ACT_TIMEOUT_S,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Count how often planners crash in a suite, and test whether each crashes more often than the one named before it.

    Pairs are compared on the same cases by McNemar's exact test. In harmless neighbours a planner also fails if it is
    held up, so that standing still does not win. Planners drive in the mirror.

    Parameters
    ----------
    planner
        name of a planner; repeat the option for each planner, the best first
    """
    from regents_cosim.cases.suite import cases_on_disk
    from regents_cosim.evaluation.drives.driving import drive_each
    from regents_cosim.evaluation.suites.ranking import rank_rows
    from regents_cosim.reports.tables import RANKED

    terminal = open_terminal(talk)
    cases = cases_on_disk(suite)
    driven = [
        (name, list(terminal.each(drive_each(cases, name, act_timeout), f"driving {name}", len(cases))))
        for name in planner
    ]
    rows = rank_rows(driven).to_dict()
    terminal.show(
        f"{counted(len(rows), 'planner')} in the {counted(len(cases), 'case')} of {suite}", rows, essential=RANKED
    )
    return PLANNER_FAILED if any(drive.error for _, drives in driven for drive in drives) else 0


@suites.command
def merge(*folders: SuiteFolder, output: Output, seed: Seed = 0, talk: OutputOptions = OutputOptions()) -> int:
    """Merge several suites and their baselines into one; different cases of the same name are an error.

    Merging the shards of a run gives, byte for byte, the suite of the undivided run.

    Parameters
    ----------
    folders
        the suites
    output
        folder for the merged suite
    seed
        random seed to store in suite.json
    """
    from regents_cosim.evaluation.suites.folders import merge_into
    from regents_cosim.runs.merging import merge_shards, shards_in

    if len(folders) < 2:
        raise RegentsError(f"{len(folders)} suites named, expected two or more to merge")
    terminal = open_terminal(talk)
    divided = shards_in(folders) is not None
    count = merge_shards(output, folders) if divided else merge_into(output, folders, seed)
    terminal.say(f"{counted(count, 'case')} of {len(folders)} {'shards' if divided else 'suites'} in {output}")
    if talk.json:
        terminal.publish("", {"folder": str(output), "cases": count})
    return 0
