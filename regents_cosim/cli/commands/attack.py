"""`regents attack`: attacks cases or traffic, and saves the attacked cases."""

from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from regents_cosim.cli.groups import Advanced, OfTraffic
from regents_cosim.cli.options import (
    ActTimeout,
    AskedFor,
    CampaignOptions,
    CasePath,
    Count,
    Executor,
    OutputIfAny,
    OutputOptions,
    Pictures,
    PlannerName,
    SearchOptions,
    SettingsFile,
    SumoOptions,
    Switch,
    TrafficOptions,
    Verify,
    search_options,
)
from regents_cosim.cli.shared import (
    exit_code,
    given_traffic,
    names_traffic,
    open_terminal,
    planner_errors,
    require_other_folder,
    share,
)
from regents_cosim.errors import PLANNER_FAILED, RegentsError
from regents_cosim.plain_text import counted
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S

if TYPE_CHECKING:
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.runs.growing import Growth

_MOST_SHOWN = 6  # most cells named in a line


def attack(
    cases: Annotated[CasePath | None, OfTraffic] = None,
    *,
    traffic: TrafficOptions = TrafficOptions(),
    planner: PlannerName = "idm",
    output: OutputIfAny = None,
    search: SearchOptions = SearchOptions(),
    batch: Annotated[Count, Advanced] = 32,
    engine: Annotated[Literal["auto", "threads", "batched"], Advanced] = "auto",
    act_timeout: ActTimeout = ACT_TIMEOUT_S,
    executor: Executor = "local",
    judge: Annotated[Switch, Advanced] = True,
    verify: Verify = True,
    pictures: Pictures = True,
    campaign: CampaignOptions = CampaignOptions(),
    settings: SettingsFile = None,
    talk: OutputOptions = OutputOptions(),
    sumo: SumoOptions = (),
    asked: AskedFor,
) -> int:
    """Find how another road user could make the planner crash; verify every crash in SUMO.

    After an interruption the same command continues.

    Parameters
    ----------
    cases
        a recorded case or a folder of them, as `regents record` makes them; or name traffic, for example with -c
    output
        folder for the attacked cases; required without --into
    batch
        scenarios held on the device at once
    engine
        threads: one scenario per core; batched: `batch` searches in one program; auto: batched on a GPU, else threads.
        The two round differently: results are not equal bit for bit, and a search may end differently
    judge
        judge every crash: what spoils it as a test, and whether a careful driver avoids it
    """
    config = search.config()  # refused before anything is imported that takes a while

    from regents_cosim.cases.files import load_case
    from regents_cosim.evaluation.crashes.failures import reasons_in_words, reasons_without_crash
    from regents_cosim.planners.under_test import PlannerUnderTest
    from regents_cosim.reports.picture import still
    from regents_cosim.reports.tables import ATTACKED, ATTACKED_IN_VAIN, attack_row, summary
    from regents_cosim.runs.attack_run import attacked_headers
    from regents_cosim.runs.folders import attack_into, grow_suite
    from regents_cosim.runs.requests import parse_manoeuvres
    from regents_cosim.runs.traffic import SavedCases
    from regents_cosim.runs.window_job import AttackRun

    terminal = open_terminal(talk)
    campaign.check_growth(executor)
    _require_one_input(cases, traffic, sumo, [place for place in (output, campaign.into) if place])
    wanted = parse_manoeuvres(campaign.manoeuvres, traffic.count)
    under_test = PlannerUnderTest.of(planner)
    run = AttackRun(config, under_test, batch, engine, act_timeout, judge, verify, pictures, wanted)
    windows = given_traffic(traffic, sumo) if cases is None else SavedCases(cases, traffic.seed)
    if campaign.into is not None:
        growth = grow_suite(
            campaign.into, run, windows, minutes=campaign.minutes, output=output, still=still, progress=terminal
        )
        for place in (campaign.into, output):
            if place is not None and place.exists():  # without a new case there is no output
                asked.keep(place, config.settings, grown=True)
        return _show_growth(growth, campaign.into, run.planner.name, terminal)
    if output is None:
        raise RegentsError("expected a folder for the attacked cases with -o, or a suite that grows with --into")
    record = attack_into(
        output, run, windows, still=still, shard=share(campaign.shard, terminal), retry=campaign.retry,
        executor=executor, progress=terminal,
    )  # fmt: skip
    asked.keep(output, config.settings)
    attacked, replays = attacked_headers(record, output)
    why = reasons_without_crash(load_case(output / one.id) for one in attacked if one.judgement is None)
    rows = [attack_row(one, replays.get(one.id), why.get(one.id)) for one in attacked]
    title = f"{config.method} against {run.planner.name}: {counted(len(rows), 'case')} in {output}"
    note = "\n".join((summary(attacked, replays), *reasons_in_words(why)))
    terminal.show(title, rows, note, ATTACKED_IN_VAIN if any(row["why"] for row in rows) else ATTACKED)
    terminal.suggest(("regents", "report", output, "-o", "report.html"))
    return max(exit_code(replays.values(), terminal), planner_errors(attacked, terminal))


def attack_by(method: str) -> Callable[..., int]:
    """The command with the fields of the method among its settings. Raises RegentsError."""

    @wraps(attack)
    def command(*given: Any, **named: Any) -> int:
        return attack(*given, **named)

    command.__annotations__ = attack.__annotations__ | {"search": search_options(method)}
    return command


def _require_one_input(
    cases: Path | None, traffic: TrafficOptions, sumo: tuple[str, ...], outputs: Sequence[Path]
) -> None:
    """Raise RegentsError unless exactly one of cases or traffic is named, together with what it needs."""
    if cases is None:
        if not names_traffic(traffic):
            raise RegentsError(
                "nothing to attack: expected a case or a folder of cases (shipped:standard, say), or traffic "
                "(-c NAME.sumocfg, -c shipped:merge, --from highway:ENVIRONMENT, --log PATH)"
            )
        return
    if names_traffic(traffic):
        raise RegentsError(f"both cases ({cases}) and traffic are named: expected one of them")
    if sumo:
        raise RegentsError("what follows -- goes to SUMO, which records nothing here: leave it out, or name traffic")
    for output in outputs:
        require_other_folder(output, cases)


def _show_growth(growth: "Growth", suite: Path, planner: str, terminal: "Terminal") -> int:
    from regents_cosim.cases.manifest import find_cases
    from regents_cosim.runs.behaviour_map import archive_of

    title = f"{counted(len(growth.added), 'case')} added to {suite}, found in {counted(growth.windows, 'window')}"
    terminal.show(title, growth.to_dict(), _growth_note(growth, planner), ("case", "why"))
    terminal.say(f"{suite}: {archive_of(find_cases(suite)).summary()}")
    if growth.added:
        terminal.suggest(("regents", "report", suite, "-o", "report.html"))
    for error in growth.errors:
        terminal.say(error.partition("\n")[0])
    return PLANNER_FAILED if growth.errors else 0


def _growth_note(growth: "Growth", planner: str) -> str:
    """A summary of the cells in which the planner newly fails, and of how the run ended."""
    new = [one for one in growth.added if one.why == "new cell"]
    cells = "; ".join(" ".join(one.cell) for one in new[:_MOST_SHOWN]) + ("; ..." if len(new) > _MOST_SHOWN else "")
    known = growth.crashes - len(growth.added)
    said = [f"{planner} crashes in {counted(growth.crashes, 'case')}, {known} of them of kinds known"]
    if new:
        said.append(f"{planner} newly fails in {len(new)} cells: {cells}")
    if growth.used_up:
        said.append("there are no more windows: another --seed or a larger --count gives other traffic")
    return "\n".join(said)
