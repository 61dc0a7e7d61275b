"""The attack: scenarios in, attacked scenarios out, with one scenario per thread or many in one program."""

from collections.abc import Iterable, Iterator, Sequence, Sized
from functools import partial
from pathlib import Path
from typing import Literal, get_args

import jax

from regents_cosim.attacks.descent.step import ExtraCost
from regents_cosim.attacks.engines import in_batches, on_hosts, search_one, side_by_side
from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED, AttackConfig, preset
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.attacks.starts.wanted_manoeuvres import DriveManoeuvres
from regents_cosim.checks.arguments import require_one_of
from regents_cosim.checks.ranges import Range
from regents_cosim.errors import RegentsError
from regents_cosim.mirror.programs.jax_settings import require_device
from regents_cosim.planners.hosting.host_pool import HostPool
from regents_cosim.planners.time_limits import ACT_TIMEOUT, ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.progress import ShowProgress, logs_items, progress_for
from regents_cosim.system.workers import in_turn

_BATCH = Range(1, 100_000, "scenarios on the device at once", whole=True)

Engine = Literal["auto", "threads", "batched"]


def attack(
    scenarios: Iterable[Scenario] | Scenario,
    method: str | AttackConfig = REGENTS_FOCUSED.method,
    planner: AnyPlanner = "idm",
    batch: int = 32,
    extra_cost: ExtraCost | None = None,
    engine: Engine = "auto",
    act_timeout_s: float = ACT_TIMEOUT_S,
    *,
    progress: ShowProgress = True,
) -> Iterator[Scenario]:
    """Find how another road user could make `planner` crash; yields attacked scenarios as soon as they are found.

    `scenarios` are recorded ones, or a single one. `method` is the name of a method (focused, king, regents, ...) or an
    AttackConfig, one of your own included. `attack_each` explains the other arguments, results and errors. Crashes are
    not judged or verified yet: `judge` judges one, and `replay` verifies it in SUMO. On a terminal and in notebooks a
    bar shows the progress, unless `progress` is False.
    """
    chosen = method if isinstance(method, AttackConfig) else preset(method)
    if isinstance(scenarios, str | Path):
        raise RegentsError(f"attack() takes scenarios, found the path {scenarios} (read them with load_suite)")
    scenarios = [scenarios] if isinstance(scenarios, Scenario) else scenarios
    total = len(scenarios) if isinstance(scenarios, Sized) else None
    windows = attack_each(scenarios, chosen, planner, batch, extra_cost, engine, act_timeout_s)
    for results in progress_for(progress).each(windows, "attacking", total, window_row):
        yield from results


def window_row(results: Sequence[Scenario]) -> str:
    """The result of one window in a line."""
    records = [case.attack for case in results if case.attack]
    crashes = [case for case in results if case.crash]
    judged = [case.judgement for case in crashes if case.judgement]
    said = f"{len(crashes)} crash{'es' * (len(crashes) > 1)}" if crashes else ""
    said += f", {sum(bool(one.telling) for one in judged)} telling" if judged else ""
    said += f", {sum(bool(one.flawless) for one in judged)} flawless" if judged else ""
    return f"{records[0].case}: {said or records[0].outcome.replace('_', ' ')}" if records else "nothing kept"


def _ended(results: list[Scenario]) -> str:
    """The ends of the searches on one scenario, for the log file."""
    said = []
    for case in results:
        assert case.attack is not None
        hit = case.attack.collision
        with_whom = f" with {hit.agent} at step {hit.step}" if hit else ""
        said.append(f"{case.id}: {case.attack.outcome}{with_whom}, {case.attack.iterations} iterations")
    return "attacked " + "; ".join(said)


@logs_items(_ended)
def attack_each(
    scenarios: Iterable[Scenario],
    config: AttackConfig,
    planner: AnyPlanner = "idm",
    batch: int = 32,
    extra_cost: ExtraCost | None = None,
    engine: Engine = "auto",
    act_timeout_s: float = ACT_TIMEOUT_S,
    wanted: DriveManoeuvres | None = None,
) -> Iterator[list[Scenario]]:
    """Attack every scenario, in order; yields the results of each as soon as it is done.

    A joint search gives one result; a search per candidate gives one for every distinct adversary that succeeds, or one
    without a collision. The search never fails: `attack.outcome` says how it ended. At most `batch` scenarios are on
    the device at once. Raises PlannerError where the planner cannot be found, RegentsError for a scenario that was
    attacked before.

    `engine` is "threads", one scenario per core, or "batched", `batch` searches in one program; "auto" takes threads on
    a CPU and batches on an accelerator. Batches are for planners in JAX that drive in every iteration; all others use
    threads.

    A planner outside JAX drives in processes of its own, every `replan_every` iterations of a descent and only the most
    promising samples, at most `drives` times in a scenario. One that fails, or takes more than `act_timeout_s` [s] for
    a decision, loses only its scenario.

    `extra_cost` of (World, Motion [agent, time] with the ego in row 0, ControlArrays [agent, step]) is added to the
    cost, to ask for more than a collision; it must be differentiable by JAX.

    `wanted` describes the crashes that are asked for: a search begins only with drives that may lead to one, and ends
    only at such a crash. `attack.promised` names the wanted manoeuvres to which these drives lead.
    """
    under_test = PlannerUnderTest.of(planner)
    name, loop = under_test.name, under_test.loop
    _BATCH.check("batch", batch)
    ACT_TIMEOUT.check("act-timeout", act_timeout_s)
    require_one_of(engine, get_args(Engine), "engine")
    if loop is None:
        with HostPool(under_test, act_timeout_s) as hosts:
            setup = AttackSetup(_replanning(config, 10), None, name, extra_cost, wanted).with_due_patience()
            yield from on_hosts(scenarios, setup, batch, hosts)
        return
    under_attack = AttackSetup(_replanning(config, 1), loop, name, extra_cost, wanted).with_due_patience()
    if _in_batches(under_attack.config, engine):
        yield from in_batches(scenarios, under_attack, batch)
    else:
        yield from in_turn(partial(search_one, under_attack), scenarios, ahead=batch)


def engine_of(engine: Engine) -> Engine:
    """The engine that "auto" stands for on this machine."""
    require_device()
    return engine if engine != "auto" else "threads" if jax.default_backend() == "cpu" else "batched"


def searched_together(
    planner: PlannerUnderTest, config: AttackConfig, engine: Engine, batch: int, act_timeout_s: float = ACT_TIMEOUT_S
) -> int:
    """The number of neighbouring scenarios that share a computation, on which the last bits of results depend."""
    if planner.loop is not None:
        return batch if _in_batches(_replanning(config, 1), engine) else 1
    with HostPool(planner, act_timeout_s) as hosts:
        return batch if side_by_side(hosts) else 1


def _in_batches(config: AttackConfig, engine: Engine) -> bool:
    return engine_of(engine) == "batched" and config.traffic.replan_every == 1 and config.descends


def _replanning(config: AttackConfig, default: int) -> AttackConfig:
    return config if config.traffic.replan_every else config.but(replan_every=default)
