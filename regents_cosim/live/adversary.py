"""An adversary that attaches to a running SUMO simulation, as a step listener for traci and libsumo.

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

It reads the traffic around the ego, and controls one vehicle at a time: the adversary, while it attacks. An error never
ends the user's simulation: it is reported in one line, and the adversary is detached.
"""

import copy
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

from traci.step import StepListener

from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.errors import RegentsError, require
from regents_cosim.live.attacked_ego import AdversarySetup, AdversaryState, AttackedEgo, Picks
from regents_cosim.live.attacker import AttackCounts
from regents_cosim.live.case_keeper import CaseKeeper
from regents_cosim.live.host.coordination import Coordination, Spare, simulation_of, spares
from regents_cosim.live.host.sumo_routes import GivenRoute
from regents_cosim.live.predict.moments import Moments
from regents_cosim.live.predict.traffic_ahead import CarFollowingPredictor, Predictor
from regents_cosim.live.search.plan import Plan
from regents_cosim.live.search.plans import Search
from regents_cosim.live.settings import HORIZON_S, LiveSettings, live_config
from regents_cosim.plain_text import printable
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.progress import DOING

State = AdversaryState | Literal["paused", "detached"]
When = float | Callable[[Any], bool] | None

_MOST_FIRST: tuple[AdversaryState, ...] = ("attacking", "returning", "watching", "waiting")


class Adversary(StepListener):
    """A step listener that attacks the ego in a running SUMO simulation (see the example of this module).

    Its states are waiting (for the ego), watching, attacking, returning, paused and detached.
    """

    def __init__(
        self,
        connection: Any,
        ego: Picks | Sequence[Picks],
        planner: AnyPlanner = "idm",
        method: str | AttackConfig = "focused-live",
        *,
        replan_s: float = 0.5,
        horizon_s: float = HORIZON_S,
        radius_m: float = 100.0,
        attack_when: When = None,
        output: Path | str | None = None,
        predictor: Predictor | None = None,
        route: GivenRoute | None = None,
        source: str | None = None,
        judged: bool = True,
        seed: int = 0,
        act_timeout_s: float = ACT_TIMEOUT_S,
        plan: Plan | None = None,
        spare: Spare = (),
        tell: Callable[[str], None] | None = None,
    ) -> None:
        """`connection` is libsumo, traci, or one of traci's connections.

        `ego` is the id of a vehicle (which need not have departed), a vehicle type or a flow, or a function of the
        connection that returns an id; or several of these, each attacked by one vehicle at a time. An ego never
        attacks, nor does a vehicle that another adversary of this simulation has as ego or controls, or that `spare`
        names: ids, types and flows, or a function of the id. `planner` predicts how the ego reacts: any planner that
        `regents attack` takes, or `observed`. `attack_when` is None (always), the earliest time [s], or a function of
        the connection. `route` is the line that the ego's planner drives along: points x, y [m] of the network, or a
        function of the connection that returns them; give it for a planner that changes lanes unknown to SUMO. None:
        the ego's route in SUMO. A planner outside JAX that takes longer than `act_timeout_s` [s] for a decision has
        failed. `plan`, for example `plan_of_case` of a case, is the first plan against the first ego; it is changed
        where it would miss. Raises RegentsError for invalid values.
        """
        picks = [ego] if isinstance(ego, str) or callable(ego) else list(ego)
        require(bool(picks), "no ego, expected at least one", RegentsError)
        require(
            len(picks) == 1 or route is None,
            "a route for several egos, expected one adversary for each ego that has a route of its own",
            RegentsError,
        )
        settings = LiveSettings(replan_s, horizon_s, radius_m, judged, seed)
        connection = simulation_of(connection)
        self._sumo, self._when, self._picks = connection, attack_when, picks
        self._tell, self._said = tell or _to_stderr, set[str]()
        DOING.tell_once(self._tell)
        self._off: Literal["paused", "detached"] | None = None
        self.tally = AttackCounts()
        search = Search(planner, live_config(method), act_timeout_s)
        moments = Moments(predictor or CarFollowingPredictor(), horizon_s)
        folder = Path(output) if output is not None else None
        self._keeper = CaseKeeper(settings, search.planner_name, search.config, folder)
        self._coordination, self._is_spared = Coordination.of(connection), spares(connection, spare)
        setup = AdversarySetup(
            connection, settings, self._coordination, self._keeper, self.tally, self._say_once, self._wanted,
            route, source,
        )  # fmt: skip
        self._egos = [AttackedEgo(setup, picks[0], search, moments, plan)]
        self._egos += [AttackedEgo(setup, one, copy.deepcopy(search), copy.deepcopy(moments)) for one in picks[1:]]
        self._coordination.join(self, connection)

    # --- the switch ------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """The current state."""
        if self._off:
            return self._off
        states = {one.state for one in self._egos}
        return next(state for state in _MOST_FIRST if state in states)

    @property
    def ego(self) -> str | None:
        """The first ego that is on the road."""
        return next(iter(self.egos), None)

    @property
    def egos(self) -> tuple[str, ...]:
        """All egos that are on the road."""
        return tuple(one.ego for one in self._egos if one.ego is not None)

    @property
    def adversary(self) -> str | None:
        """The vehicle that attacks now; the first, where several egos are attacked."""
        return next(iter(self.adversaries), None)

    @property
    def adversaries(self) -> tuple[str, ...]:
        """All vehicles that attack now."""
        return tuple(one.adversary for one in self._egos if one.adversary is not None)

    @property
    def cases(self) -> list[Scenario]:
        """The cases that were kept in memory, where there is no output folder."""
        return self._keeper.cases

    def pause(self) -> None:
        """Release the controlled vehicles, and do nothing until `resume`."""
        if self._off is None:
            self._off = "paused"
            self._guarded(self._let_go)

    def resume(self) -> None:
        """Continue after `pause`."""
        if self._off == "paused":
            self._off = None
            for one in self._egos:
                one.start_over()

    def detach(self) -> None:
        """Release the controlled vehicles, and end for good."""
        if self._off != "detached":
            self._guarded(self._end)

    def cleanUp(self) -> None:  # noqa: N802
        """Detach; traci calls this when the listener is removed, or the connection closed."""
        self._say_if_never_begun()
        self.detach()

    # --- every step ------------------------------------------------------------------------------

    def step(self, t: float = 0) -> bool:  # pyright: ignore[reportIncompatibleMethodOverride]  # says always True
        """Called by traci and libsumo after every step. Returns whether the listener stays: False once detached."""
        if self._off is None:
            self._guarded(self._step)
        return self._off != "detached"

    def _guarded(self, work: Callable[[], None]) -> None:
        """Run `work`, and catch its errors, so that the user's simulation continues."""
        try:
            work()
        except (Exception, SystemExit) as error:
            known = isinstance(error, RegentsError)
            said = str(error) if known else f"{type(error).__name__}: {error}"
            self._say_once(f"detached: {said}")
            for ending in (self._let_go, self._end):
                try:
                    ending()
                except (Exception, SystemExit):  # the simulation is gone
                    continue

    def _step(self) -> None:
        egos, now_s = self._egos, float(self._sumo.simulation.getTime())
        self._coordination.saw(now_s)
        try:
            for one in egos:
                if self._off is None:
                    one.step()
        finally:
            for one in egos:
                if self._off is not None:  # a function of the user has called `pause` or `detach` in this step
                    one.let_go()
        self._coordination.held_s |= dict.fromkeys((one.held for one in egos if one.held is not None), now_s)

    def _wanted(self, now_s: float) -> bool:
        wanted = bool(self._when(self._sumo)) if callable(self._when) else self._when is None or now_s >= self._when
        return wanted and self._off is None

    # --- among others ----------------------------------------------------------------------------

    def claims(self, name: str) -> bool:
        """Whether a vehicle is one of the egos, is controlled, or is to be spared, so that no adversary may take it."""
        mine = any(name in (one.ego, one.held) for one in self._egos)
        return mine or name in self._picks or bool(self._is_spared(name))

    def give_up(self, name: str) -> None:
        """Release a vehicle, if it is controlled, because it has become the ego of another adversary."""
        for one in self._egos:
            one.give_up(name)

    def closed(self) -> None:
        """Drop all vehicles without releasing them, since the simulation has ended or was replaced."""
        if self._off != "detached":
            self._say_if_never_begun()
            self._guarded(lambda: self._end(is_gone=True))

    # --- the rest --------------------------------------------------------------------------------

    def _let_go(self) -> None:
        """Release the controlled vehicles."""
        for one in self._egos:
            one.let_go()

    def _end(self, is_gone: bool = False) -> None:
        """Release all resources, since a detached listener may be kept for long."""
        egos, self._egos, self._off = self._egos, [], "detached"
        self._coordination.leave(self)
        with ExitStack() as endings:
            for one in egos:
                endings.callback(one.end, is_gone)

    def _say_if_never_begun(self) -> None:
        for one in self._egos if self._off is None else ():
            if one.is_missed:
                self._say_once(f"the ego ({one.called}) never departed: nothing was attacked")

    def _say_once(self, line: str) -> None:
        if line not in self._said:
            self._said.add(line)
            try:
                self._tell(line)
            except Exception:  # an error of `tell` must not end the user's simulation either
                _to_stderr(line)


def _to_stderr(line: str) -> None:
    print(printable(f"regents_cosim.live: {line}"), file=sys.stderr)
