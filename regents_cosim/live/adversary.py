"""An adversary that attaches to a running SUMO simulation: a step listener for traci and libsumo.

```python
import libsumo as traci  # or: import traci
from regents_cosim import network_config
from regents_cosim.live import Adversary

traci.start(["sumo", "-c", str(network_config("crossing")), "--collision.action", "warn"])
adversary = Adversary(traci, ego="passenger", planner="observed", output="live/")
traci.addStepListener(adversary)
while traci.simulation.getTime() < 5.0:
    traci.simulationStep()  # your planner drives in between
adversary.detach()
traci.close()
```

It reads the traffic around the ego, and touches one vehicle at a time: the adversary, while it attacks. The user's
simulation never ends because of it: whatever goes wrong is said in one line, and the adversary is detached.
"""

import dataclasses
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from traci.step import StepListener

from regents_cosim.attacks.presets import METHODS, AttackConfig
from regents_cosim.cases.provenance import sha256_of
from regents_cosim.cases.suite import SuiteWriter
from regents_cosim.checks.ranges import Range
from regents_cosim.errors import RegentsError, SumoError, require
from regents_cosim.geometry.boxes import Boxes, distance, overlap
from regents_cosim.live.case import Attacked, Foretold, case_of
from regents_cosim.live.history import History, touched
from regents_cosim.live.moments import DT_S, MOST_AGENTS, Moments, with_drives
from regents_cosim.live.observed import OBSERVED
from regents_cosim.live.plan import Plan, Search
from regents_cosim.live.predict import Mirror, Predictor
from regents_cosim.live.reading import Frame, Reader
from regents_cosim.live.steer import Hand
from regents_cosim.live.traffic import Traffic
from regents_cosim.planners.under_test import AnyPlanner
from regents_cosim.scenario import Outcome, Scenario
from regents_cosim.sources.recording import is_called
from regents_cosim.sources.windows import RecordingOrigin
from regents_cosim.verdicts.judge import judge

State = Literal["waiting", "watching", "attacking", "returning", "paused", "detached"]
Picks = str | Callable[[Any], str | None]
When = float | Callable[[Any], bool] | None

_STARTS, _ITERATIONS = 4, 15  # live: there is half a second, and another moment after it
_LEARNING_RATE = 5e-3  # as far in so few iterations as offline in its median of 75
_MISSES = 3  # renewals that fail one after the other, after which a plan is given up
_LATE_S = 1.0  # after it should have met the ego
_NO_PLAN_S = 0.4  # to the contact: what is planned by then stays
_LONGEST_S = 12.0  # that one attack may take
_RESTS_S = 10.0  # that a vehicle is left alone after an attack
_TAIL_S = 2.0  # that a case goes on beyond the contact
_NEAR_MISS_M = 2.0
_CHECKED_S = (0.4, 0.8)  # ahead: whom the adversary would touch
_STOPS_M_S2 = 7.0  # to touch nobody
_OFF_LANE_M = 0.3  # so near to the middle of a lane a vehicle is given back
_LONGEST_RETURN_S = 12.0
_GAP = 1.5  # of a step
_JUMP_M = 5.0  # more than speed explains: it was teleported
_RANGES = {
    "replan_s": Range(0.05, 60.0, "seconds from one plan to the next"),
    "horizon_s": Range(2.0, 60.0, "seconds that are planned ahead, and kept of a crash"),
    "radius_m": Range(10.0, 1e4, "metres around the ego"),
}


@dataclass(eq=False)
class _Attack:
    """One that is being carried out."""

    plan: Plan
    hand: Hand
    begun_s: float
    before: Foretold  # what was predicted when it began
    closest_m: float = np.inf
    misses: int = 0
    met: bool = False  # it has touched the ego
    iterations: int = 0
    rollouts: int = 0


@dataclass(eq=False)
class _Return:
    """A vehicle on its way back to its lane after an attack."""

    plan: Plan
    attack: _Attack
    since_s: float


@dataclass
class Tally:
    """What has happened so far."""

    attacks: int = 0
    crashes: int = 0
    others_hit: int = 0  # the ego met somebody else while it was attacked
    given_back: int = 0
    adversaries: list[str] = field(default_factory=list)
    cases: list[str] = field(default_factory=list)


class Adversary(StepListener):
    """See the module. States: waiting (for the ego), watching, attacking, returning, paused, detached."""

    def __init__(
        self,
        connection: Any,
        ego: Picks,
        planner: AnyPlanner = "idm",
        method: str | AttackConfig = "focused",
        *,
        replan_s: float = 0.5,
        horizon_s: float = 5.0,
        radius_m: float = 100.0,
        attack_when: When = None,
        output: Path | str | None = None,
        keep: Literal["crashes", "near-misses"] = "crashes",
        predictor: Predictor | None = None,
        net: Path | str | None = None,
        source: str | None = None,
        judged: bool = True,
        seed: int = 0,
        tell: Callable[[str], None] | None = None,
    ) -> None:
        """`connection` is libsumo, traci, or one of traci's connections.

        `ego` is the id of a vehicle, which is waited for, a vehicle type or a flow, or a function of the connection.
        `planner` is how it is expected to react: what `regents attack` takes, or `observed`. `attack_when` is
        None for always, a time [s] from which on, or a function of the connection. Raises RegentsError for values that
        cannot be meant.
        """
        for name, value in (("replan_s", replan_s), ("horizon_s", horizon_s), ("radius_m", radius_m)):
            _RANGES[name].check(name, value)
        require(keep in ("crashes", "near-misses"), f"keep {keep!r}, expected `crashes` or `near-misses`", RegentsError)
        self._called = source
        self._sumo, self._ego_is, self._when, self._keep = connection, ego, attack_when, keep
        self._replan_s, self._horizon_s, self._radius_m = replan_s, horizon_s, radius_m
        self._net = Path(net) if net is not None else None
        self._judged, self._seed, self._tell = judged, seed, tell or _to_stderr
        self._search = Search(planner, _live(method))
        self._observed = self._search.planner_name == OBSERVED
        self._moments = Moments(predictor or Mirror(), horizon_s)
        self._writer = SuiteWriter(Path(output), seed) if output is not None else None
        self._said: set[str] = set()
        self._off: State | None = None  # paused or detached
        self.tally = Tally()
        self.cases: list[Scenario] = []  # kept where there is no output
        self._forget_run()

    # --- the switch ------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """What it does now."""
        if self._off:
            return self._off
        if self._attack is not None:
            return "attacking"
        if self._home is not None:
            return "returning"
        return "waiting" if self.ego is None else "watching"

    @property
    def adversary(self) -> str | None:
        """The vehicle that attacks now."""
        return self._attack.plan.adversary if self._attack else None

    def pause(self) -> None:
        """Give back what is held, and do nothing until `resume`."""
        if self._off is None:
            self._off = "paused"
            self._guarded(self._let_go)

    def resume(self) -> None:
        """Go on after `pause`."""
        if self._off == "paused":
            self._off = None
            self._history = None

    def detach(self) -> None:
        """Give back what is held, for good."""
        if self._off != "detached":
            self._off = "detached"
            self._guarded(self._let_go)
            self._search.close()

    def cleanUp(self) -> None:  # noqa: N802
        """Called by traci when the listener is removed, or the connection closed."""
        if self._off is None and self.ego is None and self._reader is None:
            self._say_once(f"the ego ({self._ego_is}) never departed: nothing was attacked")
        self.detach()

    # --- every step ------------------------------------------------------------------------------

    def step(self, t: float = 0) -> Literal[True]:
        """Called by traci and libsumo after every step. Always True: the listener stays."""
        if self._off is None:
            self._guarded(self._step)
        return True

    def _guarded(self, work: Callable[[], None]) -> None:
        """The user's simulation goes on whatever we do."""
        try:
            work()
        except Exception as error:
            known = isinstance(error, RegentsError)
            said = str(error) if known else f"{type(error).__name__}: {error}"
            self._say_once(f"detached: {said}")
            self._off = "detached"
            for ending in (self._let_go, self._search.close):
                try:
                    ending()
                except Exception:  # the simulation is gone
                    continue

    def _step(self) -> None:
        now = float(self._sumo.simulation.getTime())
        if now == self._now:
            return  # added twice: once a step is enough
        if now < self._now:
            self._forget_run()  # another simulation on the same connection
        elif self._reader is not None and now - self._now > _GAP * self._reader.step_s:
            self._let_go()  # many steps at once, or another simulation that begins later
            self._forget_run()
        self._now = now
        if self.ego is None and not self._find_ego():
            return
        assert self.ego is not None
        assert self._reader is not None
        frame = self._reader.frame(self.ego, now)
        if frame is None or self._jumped(frame):
            self._lose_ego(frame)
            return
        if self._history is None:
            self._history = History(self._horizon_s, self._reader.step_s)
        self._history.add(frame)
        if self._attack is not None:
            self._watch_attack(frame)
        elif self._home is not None:
            self._come_home(frame)
        elif now >= self._next_s - 1e-6 and self._wanted():
            self._next_s = now + self._replan_s
            self._look_for_plan(frame)
        self._carry_out(frame)

    def _find_ego(self) -> bool:
        picked = self._ego_is(self._sumo) if callable(self._ego_is) else self._by_name(self._ego_is)
        if picked is None or picked not in self._sumo.vehicle.getIDList():
            return False
        if self._reader is None:
            self._reader = Reader(self._sumo, self._radius_m, self._net)
            net = self._net or Path(self._reader.option("net-file"))
            source = self._called or Path(self._reader.option("configuration-file") or net).name
            self._source = RecordingOrigin("sumo", source, sha256_of(net))
        kind = self._sumo.vehicle.getVehicleClass(picked)
        if kind.startswith(("rail", "tram", "subway", "ship", "cable_car")):
            raise SumoError(f"the ego {picked!r} is of the class {kind}: not supported on rails or water")
        self.ego = picked
        return True

    def _by_name(self, name: str) -> str | None:
        """The vehicle of that id, else the first of that type or flow."""
        vehicle = self._sumo.vehicle
        if name in vehicle.getIDList():
            return name
        new = self._sumo.simulation.getDepartedIDList() if self._looked else vehicle.getIDList()
        self._looked = True
        return next((one for one in new if is_called(name, one, vehicle.getTypeID(one))), None)

    def _wanted(self) -> bool:
        if self._when is None:
            return True
        return bool(self._when(self._sumo)) if callable(self._when) else self._now >= self._when

    def _jumped(self, frame: Frame) -> bool:
        if self._history is None or not self._history.frames:
            return False
        last = self._history.frames[-1]
        way = float(np.hypot(frame.x[0] - last.x[0], frame.y[0] - last.y[0]))
        return way > _JUMP_M + max(last.speed[0], frame.speed[0]) * (frame.time_s - last.time_s)

    def _lose_ego(self, frame: Frame | None) -> None:
        """It arrived, was removed or teleported."""
        if self._attack is not None and frame is None:
            self._say_once(
                "the ego left the simulation during an attack; where SUMO takes vehicles away that touch, start it "
                "with --collision.action warn to see the crash"
            )
        self._end_attack("no_collision")
        self._let_go()
        self._history = None
        if frame is None:
            self.ego, self._looked = None, False

    # --- plans -----------------------------------------------------------------------------------

    def _traffic(self, frame: Frame) -> Traffic:
        assert self._reader is not None
        assert self._history is not None
        recent = self._history.recent_m_s()
        traffic = self._reader.traffic(frame, MOST_AGENTS, self._horizon_s, recent)
        if not self._observed:
            return traffic
        ego = traffic.ego
        most = max(recent, 2.0) / max(ego.following.speed_factor, 0.01)
        slow = dataclasses.replace(ego.following, max_speed_m_s=min(most, ego.following.max_speed_m_s))
        return dataclasses.replace(traffic, users=(dataclasses.replace(ego, following=slow), *traffic.users[1:]))

    def _look_for_plan(self, frame: Frame) -> None:
        assert self._reader is not None
        if len(frame.ids) < 2 or frame.speed[0] < 0.5:
            return
        self._barred = {name: until for name, until in self._barred.items() if until > self._now}
        moment = self._moments.of(self._traffic(frame))
        at_stops = {name for name in frame.ids[1:] if frame.speed[frame.number[name]] < 0.1 and self._is_at_stop(name)}
        plan = self._search.fresh(moment, self._barred.keys() | at_stops, self._reader.sideways)
        if plan is None:
            return
        kind = frame.types[frame.number[plan.adversary]]
        hand = Hand(self._sumo, plan.adversary, kind.length, self._reader.road, self._reader.sideways)
        hand.take_way_of(plan)
        ids = tuple(agent.id for agent in moment.scenario.agents)
        before = Foretold(self._now, DT_S, ids, moment.scenario.tracks)
        self._attack = _Attack(plan, hand, self._now, before, iterations=plan.iterations, rollouts=plan.rollouts)
        self.tally.attacks += 1
        self.tally.adversaries.append(plan.adversary)

    def _is_at_stop(self, name: str) -> bool:
        """Whether a vehicle waits at a stop of its own, or is parked: it is left there."""
        return bool(self._sumo.vehicle.getStopState(name) & 1)

    def _watch_attack(self, frame: Frame) -> None:
        """Did it hit, is it still there, does it lead anywhere."""
        attack = self._attack
        assert attack is not None
        if attack.plan.adversary not in frame.number:
            self._attack = None  # arrived, or removed by the user's own code: there is nothing to give back
            return
        attack.hand.confirm()
        met = touched(frame)
        if met:
            attack.met = attack.plan.adversary in met
            self.tally.crashes += attack.met
            self.tally.others_hit += attack.plan.adversary not in met
            self._end_attack("collision", frame)
            return
        attack.closest_m = min(attack.closest_m, self._gap_m(frame, attack.plan.adversary))
        late = self._now > attack.plan.meets_s + _LATE_S or self._now > attack.begun_s + _LONGEST_S
        if late or attack.misses >= _MISSES:
            self._end_attack("no_collision", frame)
        elif self._now >= self._next_s - 1e-6:
            self._next_s = self._now + self._replan_s
            if attack.plan.meets_s - self._now > _NO_PLAN_S:
                self._renew(frame, attack)

    def _renew(self, frame: Frame, attack: _Attack) -> None:
        known = {attack.plan.adversary: attack.plan.rest(self._now, self._moments.steps)}
        moment = self._moments.of(self._traffic(frame), known)
        plan = self._search.renewed(moment, attack.plan.adversary)
        if plan is None:
            attack.misses += 1
            return
        attack.misses = 0
        attack.plan = plan
        attack.iterations += plan.iterations
        attack.rollouts += plan.rollouts
        attack.hand.take_way_of(plan)

    def _gap_m(self, frame: Frame, name: str) -> float:
        boxes = [Boxes(*(np.asarray(v)[k] for v in frame.boxes)) for k in (0, frame.number[name])]
        return float(distance(*boxes))

    # --- carrying out ----------------------------------------------------------------------------

    def _carry_out(self, frame: Frame) -> None:
        """Where the vehicle in our hands is to be after the next step."""
        if self._attack is not None:
            plan, hand = self._attack.plan, self._attack.hand
        elif self._home is not None:
            plan, hand = self._home.plan, self._home.attack.hand
        else:
            return
        assert self._reader is not None
        if self._attack is not None and self._touches_others(frame, plan):
            self._end_attack("no_collision", frame, stopping=True)
            if self._home is None:
                return
            plan = self._home.plan
        hand.place(*plan.at(self._now + self._reader.step_s))

    def _touches_others(self, frame: Frame, plan: Plan) -> bool:
        """Whether it would soon touch somebody but the ego, who goes straight on."""
        assert self._reader is not None
        boxes, own = frame.boxes, frame.number[plan.adversary]
        others = np.ones(len(frame.ids), bool)
        others[[0, own]] = False
        apart = np.hypot(np.asarray(boxes.x) - np.asarray(boxes.x)[own], np.asarray(boxes.y) - np.asarray(boxes.y)[own])
        others &= apart < 40.0
        if not others.any():
            return False
        kept = Boxes(*(np.broadcast_to(values, others.shape)[others] for values in boxes))
        speed, kind = frame.speed[others], frame.types[own]
        if np.any(overlap(Boxes(*(np.asarray(values)[own] for values in boxes)), kept)):
            return False  # they touch already, as SUMO has them
        for ahead_s in (self._reader.step_s, *_CHECKED_S):
            x, y, yaw, _ = plan.at(self._now + ahead_s)
            way = speed * ahead_s
            there = kept._replace(x=kept.x + way * np.cos(kept.yaw), y=kept.y + way * np.sin(kept.yaw))
            if np.any(overlap(Boxes(x, y, yaw, kind.length, kind.width, np.asarray(boxes.z)[own]), there)):
                return True
        return False

    def _end_attack(self, outcome: Outcome, frame: Frame | None = None, stopping: bool = False) -> None:
        """Save what is worth it, and send the adversary home."""
        attack, self._attack = self._attack, None
        if attack is None:
            return
        self._barred[attack.plan.adversary] = self._now + _RESTS_S
        self._home = _Return(attack.plan, attack, self._now)
        wanted = outcome == "collision" or (self._keep == "near-misses" and attack.closest_m < _NEAR_MISS_M)
        if frame is not None and wanted:
            self._save(frame, attack, outcome)
        if frame is not None:
            self._next_s = self._now + self._replan_s
            plan = _braking(attack.plan, self._now) if stopping else self._homeward(frame, attack.plan)
            self._home = None if plan is None else _Return(plan, attack, self._now)
            if plan is None:
                attack.hand.give_back()

    def _homeward(self, frame: Frame, plan: Plan) -> Plan | None:
        """A drive from where it is back to the middle of its lane, behind whom it follows."""
        traffic = self._traffic(frame)
        index = traffic.index(plan.adversary)
        if index is None:
            return None
        tracks = self._moments.predictor.predict(traffic, DT_S, self._moments.steps)
        there = int(tracks.valid[index].sum())
        rows = (np.unwrap(v[index, :there]) if k == 2 else v[index, :there] for k, v in enumerate(_states(tracks)))
        return Plan(plan.adversary, self._now, *rows, meets_s=np.inf) if there > 1 else None

    def _come_home(self, frame: Frame) -> None:
        assert self._home is not None
        home, name = self._home, self._home.plan.adversary
        hand = home.attack.hand
        if name not in frame.number:
            self._let_go()
            return
        hand.confirm()
        if name in touched(frame) and not home.attack.met:
            home.attack.met = True
            self.tally.crashes += 1
            self._save(frame, home.attack, "collision")
        if hand.off_lane_m() < _OFF_LANE_M or self._now - home.since_s > _LONGEST_RETURN_S:
            self._let_go()
        elif self._now >= self._next_s - 1e-6:
            self._next_s = self._now + self._replan_s
            onward = self._homeward(frame, home.plan)
            if onward is None:
                self._let_go()
            else:
                home.plan = onward

    def _let_go(self) -> None:
        """Give back what is held at once."""
        hand = self._attack.hand if self._attack else self._home.attack.hand if self._home else None
        self._attack, self._home = None, None
        if hand is not None:
            hand.give_back()
            self.tally.given_back += 1

    # --- cases -----------------------------------------------------------------------------------

    def _save(self, frame: Frame, attack: _Attack, outcome: Outcome) -> None:
        assert self._history is not None
        assert self._reader is not None
        traffic = self._traffic(frame)
        steps = round(_TAIL_S / DT_S) + 1
        known = {attack.plan.adversary: attack.plan.rest(self._now, steps)}
        after = with_drives(self._moments.predictor.predict(traffic, DT_S, steps), traffic, known)
        ids = tuple(user.agent.id for user in traffic.users)
        attacked = Attacked(
            attack.plan.adversary, self._search.planner_name, self._search.config, outcome, attack.iterations,
            attack.rollouts, self._replan_s, self._source, self._seed,
        )  # fmt: skip
        case = case_of(
            list(self._history.frames), self._reader.step_s, self._reader.road, attacked, attack.before,
            Foretold(self._now, DT_S, ids, after), _TAIL_S,
        )  # fmt: skip
        if self._judged:
            case = judge(case)
        if self._writer is None:
            self.cases.append(case)
        else:
            self._writer.add(case)
        self.tally.cases.append(case.id)

    # --- the rest --------------------------------------------------------------------------------

    def _forget_run(self) -> None:
        """Nothing is known of the simulation yet."""
        self.ego: str | None = None
        self._reader: Reader | None = None
        self._history: History | None = None
        self._attack: _Attack | None = None
        self._home: _Return | None = None
        self._barred: dict[str, float] = {}
        self._looked = False  # at everybody who is there
        self._now, self._next_s = -np.inf, -np.inf

    def _say_once(self, line: str) -> None:
        if line not in self._said:
            self._said.add(line)
            self._tell(line)


def _live(method: str | AttackConfig) -> AttackConfig:
    """The preset as it is searched live: one candidate at a time, few starts, few iterations."""
    if isinstance(method, AttackConfig):
        return method
    preset = METHODS.get(method)
    if preset is None or preset.optimiser != "adam":
        raise RegentsError(f"method {method!r}, expected one of focused, regents, king (or an AttackConfig)")
    starts = min(preset.starts, _STARTS)
    return dataclasses.replace(
        preset,
        search="per-candidate",
        starts=starts,
        iterations=_ITERATIONS,
        learning_rate=_LEARNING_RATE,
        attempts=1,
        patience=0,
    )


def _states(tracks: Any) -> tuple[np.ndarray, ...]:
    return tracks.x, tracks.y, tracks.yaw, tracks.speed


def _braking(plan: Plan, now_s: float) -> Plan:
    """Along a plan, but braking to a stop."""
    speed = plan.at(now_s)[3]
    since = np.arange(len(plan.x)) * DT_S
    slower = np.maximum(speed - _STOPS_M_S2 * since, 0.0)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (slower[1:] + slower[:-1]) * DT_S)])
    ahead = np.array([plan.at(now_s + step * DT_S) for step in range(len(plan.x))])
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(ahead[:, :2], axis=0).T))])
    x, y, yaw = (np.interp(way, driven, ahead[:, k]) for k in range(3))
    return Plan(plan.adversary, now_s, x, y, yaw, slower, np.inf)


def _to_stderr(line: str) -> None:
    print(f"regents_cosim.live: {line}", file=sys.stderr)
