"""`regents replay`: plays cases again, and tells whether the same crash happens."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from regents_cosim.cli.options import Cases, Executor, OutputOptions, PlannerOfCase
from regents_cosim.cli.shared import as_ended, draw, evaded_cases, exit_code, open_terminal, require_picture_name
from regents_cosim.errors import RegentsError


def replay(
    cases: Cases,
    *,
    where: Annotated[Literal["sumo", "highway", "mirror"], Parameter("--in")] = "sumo",
    mode: Literal["track", "actions"] = "track",
    background: Literal["log", "reactive"] = "log",
    ego: Literal["track", "planner", "evasion"] | None = None,
    planner: PlannerOfCase = None,
    gui: bool = False,
    record: Path | None = None,
    beside_log: bool = False,
    executor: Executor = "local",
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Replay a case, or every case of a folder, and tell whether the same crash happens.

    Parameters
    ----------
    where
        simulator of the replay: SUMO, highway-env, or the mirror
    mode
        in highway-env: track: the others follow their tracks; actions: highway-env's own physics moves them
    background
        in SUMO: log: the others follow their tracks; reactive: only the adversary does, and SUMO drives the rest
    ego
        track: the ego drives as in the case; planner: the planner drives it in closed loop (default with --planner);
        evasion: the careful driver drives it and avoids the crash
    gui
        show the replay in sumo-gui, which stays until you close it
    record
        file for a picture of one case: an animation (.gif) or a still (.png)
    beside_log
        also show the traffic before the attack, side by side (.gif)
    """
    from regents_cosim.cases.suite import load_suite
    from regents_cosim.evaluation.drives.crash_verdict import end_of_case
    from regents_cosim.planners.find import attacked_planner
    from regents_cosim.replays.replay import replay_each
    from regents_cosim.replays.replay import replay_row as ended_row
    from regents_cosim.reports.tables import REPLAYED, replay_row, replay_summary, traffic_row
    from regents_cosim.simulators.sumo.process import require_display
    from regents_cosim.system.workers import executor_for

    terminal = open_terminal(talk)
    scenarios = load_suite(cases)
    if (record or gui) and len(scenarios) > 1:
        raise RegentsError(f"{cases} holds {len(scenarios)} cases; --record and --gui show one, name its folder")
    require_picture_name(record)
    if beside_log and (record is None or record.suffix != ".gif" or scenarios[0].attack is None):
        raise RegentsError("--beside-log shows an attacked case in the .gif that --record names")
    driven_by = planner if ego in (None, "planner") else None
    if ego == "planner" and planner is None:
        driven_by = attacked_planner(scenarios)
    if ego == "evasion":
        scenarios = evaded_cases(scenarios, terminal)
    if gui and where == "sumo":
        require_display()
        terminal.say("sumo-gui stays open until you close it")
    with executor_for(executor) as pool:
        replays = replay_each(scenarios, where, driven_by, gui, pool, mode, background)
        found = list(terminal.each(replays, f"replaying in {where}", len(scenarios), ended_row))
    ended = as_ended(found[0].replayed, driven_by) if len(found) == 1 and found[0].replayed else None
    if ended and record:
        draw(ended, record, beside_log, terminal, found[0].debug)
    rows = [
        replay_row(result, not talk.json) | (traffic_row(result) if background == "reactive" else {})
        for result in found
    ]
    at_the_wheel = "the careful driver" if ego == "evasion" else driven_by or "its track"
    title = f"replayed in {where}, the ego driven by {at_the_wheel}"
    terminal.show(title, rows, replay_summary(found, ego == "evasion"), REPLAYED)
    if ended and (driven_by or found[0].verified) and (verdict := end_of_case(ended).verdict):
        terminal.say(verdict.words)
    if on_wheels := sum(len(result.as_vehicles) for result in found):
        terminal.say(
            f"{on_wheels} pedestrian{'s' * (on_wheels != 1)} moved as vehicles: SUMO's drivers, who drive the others "
            "here, do not see persons that are placed exactly"
        )
    return exit_code(found, terminal)
