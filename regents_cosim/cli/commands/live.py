"""`regents live`: lets a planner drive in running SUMO traffic, and attacks it there."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from regents_cosim.cli.groups import TRAFFIC, Advanced, OfOutput, OfPlanner, OfSearch, OfTraffic
from regents_cosim.cli.options import (
    ActTimeout,
    Count,
    Output,
    OutputOptions,
    Pictures,
    PlannerName,
    Seed,
    SumoOptions,
    Verify,
)
from regents_cosim.cli.shared import exit_code, open_terminal
from regents_cosim.errors import PLANNER_FAILED, RegentsError
from regents_cosim.plain_text import counted
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.simulators import ANY_EGO

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.live.episodes import EpisodeResult
    from regents_cosim.replays.verify import Replay
    from regents_cosim.scenario.scenario import Scenario


def live(
    *,
    config: Annotated[Path, Parameter(["--configuration-file", "-c"], group=TRAFFIC)],
    ego: Annotated[str, OfTraffic] = "auto",
    planner: PlannerName = "idm",
    expected: Annotated[str, OfPlanner] = "",
    method: Annotated[Literal["focused-live", "regents-live", "king-live"], OfSearch] = "focused-live",
    output: Output,
    episodes: Annotated[Count, OfTraffic] = 1,
    seed: Annotated[Seed, OfTraffic] = 0,
    longest: Annotated[float, OfTraffic] = 60.0,
    replan: Annotated[float, OfSearch] = 0.5,
    horizon: Annotated[float, OfTraffic] = 8.0,
    radius: Annotated[float, Advanced] = 100.0,
    gui: Annotated[bool, OfOutput] = False,
    verify: Verify = True,
    pictures: Pictures = True,
    act_timeout: ActTimeout = ACT_TIMEOUT_S,
    talk: OutputOptions = OutputOptions(),
    sumo: SumoOptions = (),
) -> int:
    """Let a planner drive in a running SUMO simulation, attack it there, and save each crash as a case.

    Parameters
    ----------
    config
        SUMO configuration (.sumocfg), or shipped:NETWORK
    ego
        id of a vehicle, or of a vehicle type or flow, whose first departing vehicle the planner drives; auto: a vehicle
        that departs among others, drawn by --seed
    expected
        planner that predicts the ego; by default the one that drives. observed: an ego that keeps to its route at its
        recent speed and brakes for leaders
    method
        method of the search: those of `regents attack` with few starts and few iterations, since another search follows
        soon
    output
        folder for the cases
    episodes
        number of runs of SUMO, each with its own seed
    seed
        random seed of the first run of SUMO
    longest
        longest time of an episode [s]; then it ends, crash or not
    replan
        time from one plan to the next [s]
    horizon
        time that is planned ahead, and that is saved of a crash [s]
    radius
        distance from the ego within which other road users are seen [m]
    gui
        show the simulation in sumo-gui, in real time
    """
    from regents_cosim.cases.files import load_case
    from regents_cosim.cases.shipped import located
    from regents_cosim.live.episodes import Episodes, forced_options, run_episodes
    from regents_cosim.live.settings import live_config
    from regents_cosim.replays.replay import verify_in_sumo
    from regents_cosim.reports.picture import draw_into_case
    from regents_cosim.reports.tables import LIVED
    from regents_cosim.saving import SuiteWriter
    from regents_cosim.simulators.sumo.config import SumoInput, other_traffic, read_input

    terminal = open_terminal(talk)
    SuiteWriter(output, seed)  # fail before anything runs if the folder cannot be written
    options = read_input(SumoInput(config=located(config), extra=sumo))
    for said in filter(None, (other_traffic(options, forced_options(seed), {}), options.turned_off())):
        terminal.say(said)
    made = Episodes(
        options, ego, planner, live_config(method), expected,
        replan_s=replan, horizon_s=horizon, radius_m=radius, most_s=longest, output=output.absolute(),
        act_timeout_s=act_timeout, gui=gui,
    )  # fmt: skip
    ended = list(terminal.each(run_episodes(made, list(range(seed, seed + episodes))), "driving", episodes))
    _say_how_they_went(ended, ego, config, terminal)
    cases = [load_case(output / name) for one in ended for name in one.cases]
    replays = verify_in_sumo(cases, progress=terminal) if verify else {}
    for case in terminal.each(cases, "drawing", len(cases)) if pictures else ():
        draw_into_case(case, output)
    rows = [_row(one, {case.id: case for case in cases}, replays) for one in ended]
    terminal.show(
        f"{method} against {planner}, live: {counted(len(rows), 'episode')}", rows, _summary(ended, cases), LIVED
    )
    failed = any(one.how in ("planner failed", "process died") for one in ended)
    return max(exit_code(replays.values(), terminal), PLANNER_FAILED if failed else 0)


def _say_how_they_went(ended: "Sequence[EpisodeResult]", ego: str, config: Path, terminal: "Terminal") -> None:
    """Show the messages of each episode. Raises RegentsError where none had the ego."""
    if all(one.how == "never departed" for one in ended):
        if ego == ANY_EGO:
            raise RegentsError(
                f"{config}: no ego found (expected vehicles that depart among others; try another --seed)"
            )
        raise RegentsError(f"the ego {ego!r} never departed (expected a vehicle, a vehicle type or a flow of {config})")
    for one in ended:
        for line in one.told:
            terminal.say(f"seed {one.seed}: {line}")


def _row(ended: "EpisodeResult", cases: "Mapping[str, Scenario]", replays: "Mapping[str, Replay]") -> dict[str, Any]:
    """The table row of an episode, with the data of its last case."""
    case = cases[ended.cases[-1]] if ended.cases else None
    replay = replays.get(case.id) if case else None
    judgement = case.judgement if case else None
    return {
        "seed": ended.seed,
        "ego": ended.ego,
        "ended": ended.how,
        "after_s": ended.lasted_s,
        "attacks": ended.attacks,
        "adversary": ended.adversary,
        **{grade: getattr(judgement, grade, None) for grade in ("clean", "telling", "flawless")},
        "SUMO_verified": replay.verified if replay else None,
        "case": case.id if case else "",
    }


def _summary(ended: "Sequence[EpisodeResult]", cases: "Sequence[Scenario]") -> str:
    """The number of episodes by outcome, and the number of telling crashes."""
    from regents_cosim.evaluation.drives.crash_verdict import CrashCounts, end_of_case

    hows = ", ".join(f"{number} {how}" for how, number in Counter(one.how for one in ended).most_common())
    counts = CrashCounts.of(map(end_of_case, cases))
    return f"episodes: {hows}; {counts.telling} telling crashes, {counts.flawless} flawless"
