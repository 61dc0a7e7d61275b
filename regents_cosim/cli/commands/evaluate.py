"""`regents evaluate`: lets a planner drive cases, and compares it with a baseline."""

import dataclasses
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from regents_cosim.cli.groups import OfRun
from regents_cosim.cli.options import (
    ActTimeout,
    BaselineOptions,
    Cases,
    Executor,
    OutputIfAny,
    OutputOptions,
    PlannerName,
)
from regents_cosim.cli.shared import open_terminal, share
from regents_cosim.errors import NEGATIVE_VERDICT, PLANNER_FAILED, RegentsError
from regents_cosim.plain_text import counted
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S

if TYPE_CHECKING:
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.evaluation.regression.comparison import RegressionVerdict
    from regents_cosim.evaluation.regression.evaluate import BaselineComparison, Evaluation

_STDOUT = Path("-")
_log = logging.getLogger(__name__)


def evaluate(
    cases: Cases,
    *,
    planner: PlannerName,
    where: Annotated[Literal["mirror", "sumo", "highway"], Parameter("--in")] = "mirror",
    background: Literal["log", "reactive"] = "log",
    baseline: BaselineOptions = BaselineOptions(),
    act_timeout: ActTimeout = ACT_TIMEOUT_S,
    executor: Executor = "local",
    output: OutputIfAny = None,
    shard: Annotated[str, OfRun] = "",
    retry: Annotated[bool, OfRun] = False,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Measure how well a planner drives (route completion, collisions, red lights, driving score), or if it got worse.

    Parameters
    ----------
    where
        simulator to drive in: the mirror, SUMO, or highway-env
    background
        log: in SUMO the others follow their tracks; reactive: only the adversary does, and SUMO drives the rest
    output
        folder that keeps every drive; after an interruption the same command continues from there
    shard
        NUMBER/COUNT: do only this share of the cases, e.g. 3/64, into its own folder (-o); default in a SLURM job
        array: the share of the task
    retry
        repeat drives that failed before
    """
    from regents_cosim.evaluation.regression.evaluate import COMPARING
    from regents_cosim.evaluation.regression.evaluate import evaluate as run_evaluate
    from regents_cosim.reports.tables import DRIVEN
    from regents_cosim.system.files.output_files import require_output
    from regents_cosim.system.workers import executor_for

    terminal = open_terminal(talk)
    if (baseline.strict or baseline.markdown) and not (baseline.baseline or baseline.update or baseline.fail_on):
        raise RegentsError(f"{COMPARING} compare with a baseline: add --baseline")
    if baseline.markdown == _STDOUT and talk.json:
        raise RegentsError("--json and --markdown - would both print to stdout: name a file for the summary")
    if baseline.markdown is not None and baseline.markdown != _STDOUT:
        require_output(baseline.markdown)
    with executor_for(executor) as pool:
        found = run_evaluate(
            cases, planner, where=where, background=background, baseline=baseline.baseline, update=baseline.update,
            fail_on=baseline.fail_on, known_as=baseline.known_as, act_timeout_s=act_timeout, executor=pool,
            progress=terminal, keep=output, retry=retry, shard=share(shard, terminal),
        )  # fmt: skip
    for drive in found.errors:
        for line in drive.trace.splitlines():
            _log.info("%s: %s", drive.case, line)
    if found.comparison is not None:
        return _show_verdicts(found, found.comparison, cases, baseline, terminal)
    rows = [row.row() for row in found.rows]
    among = " among traffic that reacts" if background == "reactive" else ""
    terminal.show(
        f"{planner} on {counted(len(found.drives), 'case')} in {where}{among}", rows, str(found.counts), DRIVEN
    )
    for drive in found.errors:
        terminal.say(f"{drive.case}: {drive.error}")
    return PLANNER_FAILED if found.errors else 0


def _show_verdicts(
    found: "Evaluation", held: "BaselineComparison", cases: Path, options: BaselineOptions, terminal: "Terminal"
) -> int:
    from regents_cosim.cases.manifest import suite_of
    from regents_cosim.cases.shipped import is_own
    from regents_cosim.evaluation.regression.comparison import how_to_accept, reproduce, tally

    suite = suite_of(cases)
    _show(found, held, suite, options, terminal)
    terminal.say(tally(held.verdicts))
    terminal.say(str(found.counts))
    for verdict in held.verdicts:
        if verdict.fails(options.strict, options.update):
            terminal.say(f"{verdict.case}: {'; '.join(verdict.reasons)}")
            terminal.say(f"  see it: {reproduce(suite / verdict.case, found.planner, found.where)}")
    for case in held.unused:
        terminal.say(f"{'removed' if options.update else 'unused'} baseline entry: {case}")
    accepting = "--update" if options.baseline or is_own(suite) else "--update --baseline FILE"
    hint = "" if options.update else how_to_accept(held.verdicts, accepting)
    for line in filter(None, (held.stranger, hint)):
        terminal.say(line)
    failed = held.fails(options.strict)
    if held.accepted is None:
        return NEGATIVE_VERDICT if failed else 0
    terminal.say(f"accepted {len(held.accepted)} changes in {held.file}")
    for line in held.accepted:
        terminal.say(f"  {line}")
    return PLANNER_FAILED if failed else 0


def _show(
    found: "Evaluation", held: "BaselineComparison", suite: Path, options: BaselineOptions, terminal: "Terminal"
) -> None:
    from regents_cosim.evaluation.regression.comparison import markdown
    from regents_cosim.reports.tables import COMPARED
    from regents_cosim.system.files.output_files import MARK, write_output_file

    asked = options.strict, options.update
    summary = markdown(held.verdicts, suite, found.planner, found.where, held.unused, *asked)
    if options.markdown == _STDOUT:
        terminal.write(summary)
        return
    rows = [dataclasses.asdict(v) if terminal.json else _row(v) for v in held.verdicts]
    against = f" against {held.file}" if held.file is not None else ""
    terminal.show(f"{found.planner} in {found.where}{against}", rows, essential=COMPARED)
    if options.markdown is not None:  # last: a full disk does not hide the verdicts
        write_output_file(options.markdown, f"<!-- {MARK} -->\n{summary}".encode())


def _row(verdict: "RegressionVerdict") -> dict[str, Any]:
    from regents_cosim.evaluation.regression.comparison import short

    return {
        "case": verdict.case,
        "verdict": verdict.status,
        "baseline": short(verdict.before),
        "now": short(verdict.now),
        "why": "; ".join(verdict.reasons) or None,
    }
