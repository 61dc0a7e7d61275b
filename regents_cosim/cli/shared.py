"""Shared parts of commands: get traffic, verify, draw, report failures."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from regents_cosim.cli.options import OutputOptions, TrafficOptions
from regents_cosim.errors import NEGATIVE_VERDICT, PLANNER_FAILED, RegentsError
from regents_cosim.system.files.output_files import require_output

if TYPE_CHECKING:
    from regents_cosim.cases.header import Header
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.planners.interface import DebugSteps
    from regents_cosim.replays.verify import Replay
    from regents_cosim.runs.shards import Shard
    from regents_cosim.runs.traffic import Traffic
    from regents_cosim.scenario.scenario import Scenario
    from regents_cosim.simulators.sumo.config import SumoInput
    from regents_cosim.sources.record import LogInput


def open_terminal(talk: OutputOptions) -> "Terminal":
    """The terminal for results and progress, as the options say."""
    from regents_cosim.cli.run_log import begin_run_log
    from regents_cosim.cli.terminal import Terminal

    begin_run_log(talk)
    return Terminal(talk.quiet, talk.json, talk.wide, talk.verbose)


def given_traffic(traffic: TrafficOptions, sumo: tuple[str, ...]) -> "Traffic":
    """The traffic that the options name, and the windows wanted of it. Raises RegentsError."""
    from regents_cosim.runs.traffic import Traffic

    return Traffic(
        _source(traffic, sumo), count=traffic.count, seed=traffic.seed, horizon_s=traffic.horizon,
        radius_m=traffic.radius, prefer=traffic.prefer, max_agents=traffic.max_agents, ego_kind=traffic.ego_kind,
        fcd=traffic.fcd, policy=traffic.policy,
    )  # fmt: skip


def _source(traffic: TrafficOptions, sumo: tuple[str, ...]) -> "SumoInput | LogInput | str":
    from regents_cosim.simulators.sumo.config import SumoInput
    from regents_cosim.sources.record import LogInput

    if not names_traffic(traffic):
        raise RegentsError(
            "no traffic named (expected -c NAME.sumocfg, -n NET with -r ROUTES or --fcd LOG, "
            "--from highway:ENVIRONMENT, or --log PATH)"
        )
    if traffic.log is not None:
        if traffic.config or traffic.net or traffic.fcd or traffic.source:
            raise RegentsError("--log stands alone; SUMO's own fcd-output is read with --fcd LOG -n NET")
        return LogInput(traffic.log, traffic.format, traffic.ego, traffic.stride, traffic.map, traffic.columns)
    if traffic.source and not traffic.source.startswith("highway:"):
        raise RegentsError(f"--from {traffic.source}: expected highway:ENVIRONMENT, e.g. highway:merge-v1")
    if traffic.source and traffic.ego != "auto":
        raise RegentsError(f"--ego {traffic.ego}: an environment of highway-env has one ego of its own; leave it out")
    return traffic.source or SumoInput(
        config=traffic.config,
        net=traffic.net,
        routes=tuple(map(Path, words_in(traffic.routes))),
        additional=tuple(map(Path, words_in(traffic.additional))),
        begin_s=traffic.begin,
        end_s=traffic.end,
        extra=sumo,
        ego=traffic.ego,
    )


def names_traffic(traffic: TrafficOptions) -> bool:
    """Whether the options name any traffic."""
    return bool(traffic.config or traffic.net or traffic.source or traffic.log)


def words_in(text: str) -> tuple[str, ...]:
    """What is separated by commas."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


def share(asked: str, terminal: "Terminal") -> "Shard":
    """The share asked for, or that of this task of a SLURM array, with a message. Raises RegentsError."""
    from regents_cosim.runs.shards import WHOLE, parse_shard, slurm_shard

    if asked:
        return parse_shard(asked)
    found = slurm_shard(os.environ)
    if found is not None:
        terminal.say(f"shard {found}, by SLURM's job array (--shard 1/1 does all of it)")
    return found or WHOLE


def require_other_folder(output: Path, cases: Path) -> None:
    """Raise RegentsError where attacked cases would be saved among the cases that are attacked."""
    from regents_cosim.cases.manifest import suite_of

    if output.resolve() == suite_of(cases).resolve():
        raise RegentsError(
            f"{output} is the folder that the cases are read from, and what was attacked is not attacked again: "
            "choose another folder"
        )


def require_picture_name(record: Path | None) -> None:
    """Raise RegentsError for a name without a picture format, or where no picture of ours could be written."""
    if record is None:
        return
    if record.suffix not in (".gif", ".png"):
        raise RegentsError(f"--record {record}: expected a name that ends in .gif (moves) or .png (a still)")
    require_output(record)


def evaded_cases(scenarios: "list[Scenario]", terminal: "Terminal") -> "list[Scenario]":
    """The cases with an evasion, driven by the careful driver. Raises RegentsError for a single case without one."""
    from regents_cosim.verdicts.careful.evasion import evaded

    known = [scenario for scenario in scenarios if scenario.evasion is not None] or scenarios[:1]
    if len(known) < len(scenarios):
        terminal.say(f"{len(scenarios) - len(known)} of {len(scenarios)} cases have no evasion and are left out")
    return [evaded(scenario) for scenario in known]


def as_ended(scenario: "Scenario", driven_by: str | None) -> "Scenario":
    """A replayed case as it ended where `driven_by` drove it, with a judgement of its crash."""
    from regents_cosim.evaluation.drives.crash_verdict import as_driven
    from regents_cosim.verdicts.judge import judge

    if driven_by is not None:
        scenario = as_driven(scenario, driven_by)
    return judge(scenario) if scenario.collision and scenario.judgement is None else scenario


def draw(scenario: "Scenario", path: Path, beside_log: bool, terminal: "Terminal", debug: "DebugSteps" = ()) -> None:
    """Draw one case as a still or an animation; `debug` is what its planner thought."""
    from regents_cosim.reports.picture import animate, animate_pair, draw_still

    with terminal.waiting(f"drawing {path}"):
        if beside_log:
            animate_pair(scenario.before_attack(), scenario, path)
        else:
            (animate if path.suffix == ".gif" else draw_still)(scenario, path, debug=debug)


def planner_errors(attacked: "Iterable[Header | Scenario]", terminal: "Terminal") -> int:
    """Exit code 4 if the planner failed in a case, else 0; reports the failures."""
    records = [scenario.attack for scenario in attacked if scenario.attack and scenario.attack.planner_error]
    for record in records:
        terminal.say(f"{record.case}: {record.planner_error.partition(chr(10))[0]}")
    return PLANNER_FAILED if records else 0


def exit_code(replays: "Iterable[Replay]", terminal: "Terminal") -> int:
    """Exit code 4 if the planner failed, 1 if a replay differs from its case, else 0; reports why."""
    failed = [replay for replay in replays if not replay.verified]
    for replay in failed:
        terminal.say(f"{replay.case}: {replay.reason}")
    if any(replay.planner_failed for replay in failed):
        return PLANNER_FAILED
    return NEGATIVE_VERDICT if failed else 0
