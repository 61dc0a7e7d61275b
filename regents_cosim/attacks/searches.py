"""Run the searches on one scenario, or on several together, from their candidates to the resulting cases."""

import itertools
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float

from regents_cosim.attacks.attacked_cases import attacked_case, cases_of, failed_case, outcome_of
from regents_cosim.attacks.candidates import candidates_or_failure
from regents_cosim.attacks.descent.search import LOOKED_AT, in_one_look
from regents_cosim.attacks.descent.search_state import SearchResult
from regents_cosim.attacks.job import Merit, SearchEnd, SearchJob
from regents_cosim.attacks.methods.attempts import USUAL
from regents_cosim.attacks.methods.moves import Asked, Descend, LookAt, MakeMoves, Move, begun, search_in_turns
from regents_cosim.attacks.planner_drives import PlannerDrives
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.errors import DriveError
from regents_cosim.geometry.lines import way_at
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.norms.careful import CAREFUL
from regents_cosim.norms.grades import AdversaryMay
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT
from regents_cosim.planners.jax_planner import foreign
from regents_cosim.scenario.judgement import Judgement
from regents_cosim.scenario.scenario import VEHICLE_KINDS, Scenario
from regents_cosim.verdicts.careful.evasion import room_m
from regents_cosim.verdicts.judge import judged_if_preventable
from regents_cosim.verdicts.usualness import peak_effort, usualness


@in_float32
def search_together(
    setup: AttackSetup,
    scenarios: list[Scenario],
    make: MakeMoves,
    drives: PlannerDrives | None = None,
    pool: Executor | None = None,
) -> list[list[Scenario]]:
    """The results of several scenarios whose moves are made together; `pool` prepares them.

    `drives` are those that the moves ask for, of a planner that is asked now and then.

    Where the planner raises an error in their shared program, each scenario is run alone.
    """
    try:
        with foreign(setup.planner_name, scenarios[0].id):
            return _search(setup, scenarios, make, drives, pool)
    except DriveError as failure:
        if len(scenarios) == 1:
            return [[failed_case(setup, scenarios[0], failure)]]
    return [search_together(setup, [scenario], make, drives)[0] for scenario in scenarios]


def _search(
    setup: AttackSetup, scenarios: list[Scenario], make: MakeMoves, drives: PlannerDrives | None, pool: Executor | None
) -> list[list[Scenario]]:
    prepare = partial(candidates_or_failure, setup, make=make)
    found = list((pool.map if pool else map)(prepare, scenarios))
    candidates = [one for mine in found if not isinstance(mine, DriveError) for one in mine]
    searches = [begun(setup.config, one) for one in candidates]
    left, made = (drives.left, drives.made) if drives else (None, lambda _: 0)
    ended = iter(search_in_turns(setup.config, candidates, searches, partial(_judged, setup, make), left))
    return [
        [failed_case(setup, scenario, mine)]
        if isinstance(mine, DriveError)
        else cases_of(setup, scenario, mine, list(itertools.islice(ended, len(mine))), made(scenario))
        for scenario, mine in zip(scenarios, found, strict=True)
    ]


def _judged(setup: AttackSetup, make: MakeMoves, asked: Sequence[Asked]) -> list[SearchEnd]:
    """Make moves, with the verdict of the host where it decides which crashes are wanted."""
    acceptance = setup.config.acceptance
    ended = [_counted(move, one) for (_, _, move), one in zip(asked, make(asked), strict=True)]
    if acceptance.accept != "telling" and not acceptance.at_least_usual and setup.wanted is None:
        return ended
    found = list[SearchEnd]()
    for (scenario, job, move), one in zip(asked, ended, strict=True):
        wanted = _if_wanted(setup, scenario, job, one, isinstance(move, Descend) and move.every_hit)
        found.append(_if_usual(setup, scenario, job, _gentler(setup, make, scenario, job, wanted)))
    return found


def _counted(move: Move, ended: SearchEnd) -> SearchEnd:
    """The end of a move, with the number of its looks."""
    if not isinstance(move, LookAt) or ended.tried is None:
        return ended
    return replace(ended, looks=ended.tried.made(move.number))


def _gentler(setup: AttackSetup, make: MakeMoves, scenario: Scenario, job: SearchJob, ended: SearchEnd) -> SearchEnd:
    """The end of a move, or a better one: the same crash by an adversary that drives more gently."""
    found, outside = ended.found, setup.planner is None or setup.config.traffic.replan_every > 1
    if outside or setup.config.acceptance.accept != "telling" or not ended.accepted or ended.merit.usual >= USUAL:
        return ended
    assert isinstance(found, SearchResult)
    look = gentler_drives(attacked_case(setup, scenario, job, ended), job, found)
    if look is None:
        return ended
    (looked,) = make([(scenario, job, look)])
    better = _if_wanted(setup, scenario, job, looked, every_hit=False)
    effort = replace(ended, looks=ended.looks + look.number)
    if not isinstance(better.found, SearchResult) or not better.accepted or better.merit <= ended.merit:
        return effort
    made = eqx.tree_at(lambda one: (one.iterations, one.history), better.found, (found.iterations, found.history))
    return replace(effort, found=made, merit=better.merit)


def _if_wanted(setup: AttackSetup, scenario: Scenario, job: SearchJob, ended: SearchEnd, every_hit: bool) -> SearchEnd:
    """The end of a move, accepted only if its crash is of a wanted kind and, as far as known, telling.

    The device is stricter than the host, so every crash of a mere look is judged.
    """
    found, telling = ended.found, setup.config.acceptance.accept == "telling"
    if not isinstance(found, SearchResult) or not (ended.hit if every_hit and telling else ended.accepted):
        return ended
    if not every_hit and outcome_of(found) != "collision":
        return ended
    taken, spoilt = _with_verdict(ended, True), _with_verdict(ended, False)
    case = attacked_case(setup, scenario, job, taken)
    if setup.wanted is not None and not setup.wanted.of_crash(case):
        return spoilt
    if not telling:
        return taken
    judged, may = judged_if_preventable(case), setup.config.acceptance.adversary_may
    if judged is None or judged.judgement is None or judged.judgement.tells(may) is False:
        return spoilt
    return replace(taken, merit=_merit(judged, judged.judgement, may))


def _if_usual(setup: AttackSetup, scenario: Scenario, job: SearchJob, ended: SearchEnd) -> SearchEnd:
    """The end of a move, accepted only if its adversary drives as usually as asked for, as far as known."""
    least = setup.config.acceptance.at_least_usual
    if not least or not ended.accepted or not isinstance(ended.found, SearchResult):
        return ended
    usual = usualness(attacked_case(setup, scenario, job, ended))
    return ended if usual is None or usual >= least else _with_verdict(ended, False)


def _with_verdict(ended: SearchEnd, accepted: bool) -> SearchEnd:
    """The end of a move whose crash the host accepts, or does not."""
    found = eqx.tree_at(lambda one: one.accepted, ended.found, on_device(accepted, np.bool_))
    return replace(ended, found=found, refused=not accepted)


def _merit(judged: Scenario, judgement: Judgement, may: AdversaryMay) -> Merit:
    """The merit of a telling crash; what is not known counts as good."""
    usual, room = judgement.usual, room_m(judged)
    by_mistake = may == "mistakes" and judgement.flawless is False
    return Merit(not by_mistake, room is None or room >= CAREFUL.room_m, USUAL if usual is None else 0.01 * usual)


# Gentler drives to a crash that was found: the adversary's speeds up to the contact are made more even.
# A drive keeps the line of the found one and comes to the place of contact at the same instant: its acceleration is a
# mixture of the found one and of the constant one that covers the same way in the same time, and so covers it too.
# How gentle a drive is, is the effort by which `usualness` ranks it.
_SHARES = (1.0, 0.8, 0.6, 0.4, 0.2)  # of the constant acceleration in a mixture
_BEGINS_S = (0.0, 1.0, 2.0)  # from when on it is mixed in
_LEAST_S = 1.5  # of an even drive before the contact
_LESS = 0.95  # of the former effort: a drive that takes no less is not gentler
_STILL_M = 1e-9
_LEAST_M = 1e-3  # of way in a step that shows a curvature


class Drive(NamedTuple):
    """The drive of one agent: controls of each step, and the speeds and headings to which they lead."""

    speed: Float[np.ndarray, " time"]  # [m/s]
    yaw: Float[np.ndarray, " time"]  # [rad]
    accel: Float[np.ndarray, " step"]  # [m/s^2]
    curvature: Float[np.ndarray, " step"]  # [1/m]

    def effort(self, first: int, last: int, dt: float) -> float | None:
        """Its greatest effort between two steps; None where that is too short."""
        return peak_effort(self.speed[first : last + 1], self.yaw[first : last + 1], dt)


def gentler_drives(case: Scenario, job: SearchJob, found: SearchResult) -> LookAt | None:
    """A look at drives that lead to the crash of `case` with less effort, the gentlest first; None: there is none."""
    hit, agent = case.collision, int(job.searched.first)
    if hit is None or case.agents[agent].id != hit.agent or case.agents[agent].kind not in VEHICLE_KINDS:
        return None
    made = found.motion.speed, found.motion.yaw, found.controls.accel, found.controls.curvature
    drive = Drive(*(np.asarray(values, float)[agent] for values in made))
    first, fastest = int(np.argmax(case.tracks.valid[agent])), float(np.asarray(job.world.top_speed)[agent])
    now = drive.effort(first, hit.step, case.dt)
    tried = list[tuple[float, Drive]]()
    for mixed in mixtures(drive, first, hit.step, case.dt):
        effort = mixed.effort(first, hit.step, case.dt)
        if now and effort is not None and effort < _LESS * now and mixed.speed[first:].max() <= fastest:
            tried.append((effort, mixed))
    gentle = [mixed for _, mixed in sorted(tried, key=lambda one: one[0])[:LOOKED_AT]]
    if not gentle:
        return None
    shares = ((one.accel / ACCEL_LIMIT, one.curvature / CURVATURE_LIMIT) for one in gentle)
    actions = [ControlArrays(*(on_device(values[None], np.float32) for values in pair)) for pair in shares]
    return LookAt(in_one_look(actions), len(actions))


def mixtures(drive: Drive, first: int, last: int, dt: float) -> Iterator[Drive]:
    """The drives that come as far up to step `last`, more evenly, without a stop that the drive does not make."""
    accel = np.diff(drive.speed) / dt
    way = way_at(drive.speed, dt)
    for begin in (first + round(begins_s / dt) for begins_s in _BEGINS_S):
        seconds = (last - begin) * dt
        if seconds < _LEAST_S:
            continue
        even = 2.0 * (way[last] - way[begin] - drive.speed[begin] * seconds) / seconds**2
        for share in _SHARES:
            mixed = accel.copy()
            mixed[begin:last] += share * (even - accel[begin:last])
            speed = drive.speed[0] + np.concatenate([[0.0], np.cumsum(mixed * dt)])
            if speed[begin : last + 1].min() >= 0.0:
                yield _along(drive, way, mixed, np.maximum(speed, 0.0), dt)


def _along(
    drive: Drive,
    way: Float[np.ndarray, " time"],
    accel: Float[np.ndarray, " step"],
    speed: Float[np.ndarray, " time"],
    dt: float,
) -> Drive:
    """The drive with other speeds along the same line, as far as it leads."""
    gone = 0.5 * (speed[1:] + speed[:-1]) * dt
    rising = way + _STILL_M * np.arange(len(way))
    yaw = np.interp(np.concatenate([[0.0], np.cumsum(gone)]), rising, drive.yaw)
    return Drive(speed, yaw, accel, np.divide(np.diff(yaw), gone, out=np.zeros(len(gone)), where=gone > _LEAST_M))
