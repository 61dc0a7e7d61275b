"""Attacks one ego with one vehicle at a time: find a plan, follow it, return to the lane, release the vehicle.

This module does not depend on SUMO: it sees frames, and moves vehicles through a `Host`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from regents_cosim.live.host.interface import Frame, Host, VehicleControl, touched
from regents_cosim.live.predict.forecast import Forecast
from regents_cosim.live.safety import braking, would_touch_others
from regents_cosim.live.search.plan import Plan
from regents_cosim.live.search.replanner import Replanner
from regents_cosim.mirror.programs.jax_settings import in_float32

_LOOKS_S = 0.2  # least time between two searches for a plan
_REDRAWN_S = 0.2  # after a plan could not be changed, the vehicle's other drives are tried
_MISSES = 6  # failed searches in a row (three for a change, three for other drives) that end an attack
_LATE_S = 1.0  # delay after the planned contact that ends an attack
_NO_PLAN_S = 0.4  # before the contact the plan is not changed any more
_LONGEST_S = 12.0  # longest attack
_RESTS_S = 10.0  # time for which a vehicle is left alone after an attack
_STANDS_M_S = 0.1
_LONGEST_RETURN_S = 12.0
_RETURNS_S = 0.5  # longest time between two plans of a return, which brake for vehicles ahead
_EARLY_S = 1e-6


@dataclass(eq=False)
class Attack:
    """An attack in progress, or one whose vehicle is returning to its lane."""

    plan: Plan
    control: VehicleControl
    begun_s: float
    before: Forecast  # the prediction at its begin
    misses: int = 0  # failed searches for a new plan since the last successful one
    met: bool = False  # whether it has touched the ego
    iterations: int = 0
    rollouts: int = 0


@dataclass
class AttackCounts:
    """Counts of what has happened so far."""

    attacks: int = 0
    crashes: int = 0
    given_back: int = 0
    adversaries: list[str] = field(default_factory=list)
    cases: list[str] = field(default_factory=list)


class Attacker:
    """Attacks one ego; call `step` with every frame. `crashed` is called when the ego crashes."""

    def __init__(
        self,
        host: Host,
        replanner: Replanner,
        replan_s: float,
        tally: AttackCounts,
        crashed: Callable[[Frame, Attack], None],
        first: Plan | None = None,
    ) -> None:
        """The attack by the plan `first` begins once its vehicle is present; it is then checked like any other plan."""
        self._first = first
        self._host, self._replanner, self._replan_s = host, replanner, replan_s
        self._tally, self._crashed = tally, crashed
        self.attack: Attack | None = None
        self._home: Attack | None = None  # the attack whose vehicle is returning to its lane
        self._home_since_s = 0.0
        self._barred: dict[str, float] = {}
        self._next_s = -np.inf
        self._looks_s = min(_LOOKS_S, replan_s)

    @property
    def state(self) -> Literal["watching", "attacking", "returning"]:
        """The current state."""
        if self.attack is not None:
            return "attacking"
        return "watching" if self._home is None else "returning"

    @property
    def held(self) -> str | None:
        """The vehicle that is controlled."""
        held = self.attack or self._home
        return held.plan.adversary if held is not None else None

    @in_float32
    def step(self, frame: Frame, wanted: Callable[[], bool]) -> None:
        """Continue after a step of the simulation; `wanted` tells whether an attack may begin."""
        if self.attack is not None:
            self._watch(frame, self.attack)
        elif self._home is not None:
            self._come_home(frame, self._home)
        elif self._first is not None and self._first.adversary in frame.number and wanted():
            plan, self._first, self._next_s = self._first, None, frame.time_s + self._replan_s
            self._take(frame, plan, self._replanner.forecast(frame))
        elif not self._is_time(frame, self._looks_s):
            self._between(frame, wanted)
        elif wanted():
            self._begin(frame)
        self._carry_out(frame)

    def abandon(self, now_s: float) -> None:
        """Release the controlled vehicle at once, and bar it for a while."""
        if self.attack is not None:
            self._barred[self.attack.plan.adversary] = now_s + _RESTS_S
        self.let_go()

    def let_go(self) -> None:
        """Release the controlled vehicle at once."""
        held, self.attack, self._home = self.attack or self._home, None, None
        if held is not None:
            self._tally.given_back += held.control.give_back()

    def _is_time(self, frame: Frame, every_s: float | None = None) -> bool:
        """Whether another search is due; if so, the next one is due after `every_s` [s], by default `replan_s`."""
        if frame.time_s < self._next_s - _EARLY_S:
            return False
        self._next_s = frame.time_s + (every_s or self._replan_s)
        return True

    # --- beginning -------------------------------------------------------------------------------

    def _begin(self, frame: Frame) -> None:
        """Search for a plan, and take over its vehicle."""
        if len(frame.ids) < 2:
            return
        self._barred = {name: until for name, until in self._barred.items() if until > frame.time_s}
        standing = (name for name in frame.ids[1:] if frame.speed[frame.number[name]] < _STANDS_M_S)
        at_stops = {name for name in standing if self._host.is_at_stop(name)}
        spared = {name for name in frame.ids[1:] if self._host.is_spared(name)}
        none_between = self._host.step_s > self._looks_s - _EARLY_S
        found = self._replanner.fresh(frame, self._barred.keys() | at_stops | spared, at_once=none_between)
        if found is not None:
            self._take(frame, *found)

    def _between(self, frame: Frame, wanted: Callable[[], bool]) -> None:
        """Use a plan that samples have found in the step after a search."""
        self._replanner.prepare(frame)
        found = self._replanner.sampled()
        if found is not None and found[0].adversary in frame.number and wanted():
            self._take(frame, *found)

    def _take(self, frame: Frame, plan: Plan, before: Forecast) -> None:
        """Take over the vehicle of a plan, unless it is taken by now; `before` is the prediction without the attack."""
        if self._host.is_spared(plan.adversary):
            return
        control = self._host.take(plan.adversary, frame.types[frame.number[plan.adversary]].length)
        self.attack = Attack(plan, control, frame.time_s, before, iterations=plan.iterations, rollouts=plan.rollouts)
        control.follow_route_of(plan)
        self._tally.attacks += 1
        self._tally.adversaries.append(plan.adversary)

    # --- attacking -------------------------------------------------------------------------------

    def _watch(self, frame: Frame, attack: Attack) -> None:
        """Check whether the adversary has hit the ego, is still present, and can still reach the ego."""
        name = attack.plan.adversary
        if name not in frame.number:
            self.abandon(frame.time_s)  # arrived, out of sight, or removed by the user's code
            return
        attack.control.confirm()
        met = touched(frame)
        if met:
            attack.met = name in met
            self._tally.crashes += attack.met
            self._crashed(frame, attack)
            self._end(frame, attack)
            return
        late = frame.time_s > attack.plan.meets_s + _LATE_S or frame.time_s > attack.begun_s + _LONGEST_S
        if late or attack.misses >= _MISSES:
            self._end(frame, attack)
        elif not self._is_time(frame):
            self._replanner.prepare(frame)
        elif attack.plan.meets_s - frame.time_s > _NO_PLAN_S:
            self._renew(frame, attack)

    def _renew(self, frame: Frame, attack: Attack) -> None:
        """Change the plan where it would miss. If that fails, other drives of the vehicle are tried soon after."""
        redraws = attack.misses % 2 == 1
        if redraws:
            plan = self._replanner.redrawn(frame, attack.plan.adversary)
        else:
            plan = self._replanner.renewed(frame, attack.plan)
        if plan is None:
            attack.misses += 1
            soon_s = min(_REDRAWN_S, 0.5 * self._replan_s)
            self._next_s = frame.time_s + (self._replan_s - soon_s if redraws else soon_s)
            return
        attack.misses = 0
        attack.plan = plan
        attack.iterations += plan.iterations
        attack.rollouts += plan.rollouts
        attack.control.follow_route_of(plan)

    def _end(self, frame: Frame, attack: Attack, stopping: bool = False) -> None:
        """End an attack, and send the adversary back to its lane."""
        self._barred[attack.plan.adversary] = frame.time_s + _RESTS_S
        self._next_s = frame.time_s + self._replan_s
        self._home_since_s = frame.time_s
        plan = attack.plan
        home = braking(plan, frame.time_s) if stopping else self._replanner.homeward(frame, plan.adversary)
        if home is None:
            self.let_go()
            return
        self.attack, self._home = None, attack
        self._drive_home(attack, home)

    # --- carrying out, and back ------------------------------------------------------------------

    def _carry_out(self, frame: Frame) -> None:
        """Place the controlled vehicle for the next step."""
        if self.attack is not None and would_touch_others(frame, self.attack.plan, self._host.step_s):
            self._end(frame, self.attack, stopping=True)
        held = self.attack or self._home
        if held is not None:
            held.control.place(*held.plan.at(frame.time_s + self._host.step_s))

    def _come_home(self, frame: Frame, home: Attack) -> None:
        name = home.plan.adversary
        if name not in frame.number:
            self.let_go()
            return
        home.control.confirm()
        if name in touched(frame) and not home.met:
            home.met = True
            self._tally.crashes += 1
            self._crashed(frame, home)
        if home.control.is_at_ease() or frame.time_s - self._home_since_s > _LONGEST_RETURN_S:
            self.let_go()
        elif frame.time_s >= home.plan.begun_s + min(self._replan_s, _RETURNS_S) - _EARLY_S:
            self._next_s = frame.time_s + self._replan_s
            onward = self._replanner.homeward(frame, name)
            if onward is None:
                self.let_go()
            else:
                self._drive_home(home, onward)

    def _drive_home(self, home: Attack, plan: Plan) -> None:
        """Follow a plan back, which may leave a junction in another direction than the vehicle's route."""
        home.plan = plan
        home.control.follow_route_of(plan)
