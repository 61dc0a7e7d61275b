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

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
from traci.step import StepListener

from regents_cosim.attack_record import Outcome
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.cases.provenance import sha256_of
from regents_cosim.errors import RegentsError
from regents_cosim.live.attacker import Attack, Attacker, Tally
from regents_cosim.live.case_keeper import TAIL_S, CaseKeeper
from regents_cosim.live.ego_finder import EgoFinder, Picks
from regents_cosim.live.fork import Fork
from regents_cosim.live.frame import Frame
from regents_cosim.live.history import History
from regents_cosim.live.known_route import GivenRoute
from regents_cosim.live.moments import Moments
from regents_cosim.live.plan import Plan
from regents_cosim.live.predict import Mirror, Predictor
from regents_cosim.live.reading import Reader
from regents_cosim.live.replanner import Replanner
from regents_cosim.live.search import Search
from regents_cosim.live.settings import HORIZON_S, Keep, LiveSettings, live_config
from regents_cosim.live.sumo_host import SumoHost
from regents_cosim.planners.patience import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner
from regents_cosim.scenario import Scenario
from regents_cosim.simulators.untaken_moves import forget_at_close
from regents_cosim.sources.sumo_options import path_of
from regents_cosim.sources.windows import RecordingOrigin

State = Literal["waiting", "watching", "attacking", "returning", "paused", "detached"]
When = float | Callable[[Any], bool] | None

_GAP = 1.5  # of a step: the simulation went on without us
_PATIENCE_S = 60.0  # of simulated time, after which an ego that has not departed is told of
_JUMP_M = 5.0  # more than speed explains: the ego was teleported


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
        horizon_s: float = HORIZON_S,
        radius_m: float = 100.0,
        attack_when: When = None,
        output: Path | str | None = None,
        keep: Keep = "crashes",
        predictor: Predictor | None = None,
        net: Path | str | None = None,
        route: GivenRoute | None = None,
        source: str | None = None,
        judged: bool = True,
        seed: int = 0,
        act_timeout_s: float = ACT_TIMEOUT_S,
        plan: Plan | None = None,
        tell: Callable[[str], None] | None = None,
    ) -> None:
        """`connection` is libsumo, traci, or one of traci's connections.

        `ego` is the id of a vehicle, which is waited for, a vehicle type or a flow, or a function of the connection.
        `planner` is how it is expected to react: what `regents attack` takes, or `observed`. `attack_when` is
        None for always, a time [s] from which on, or a function of the connection. `route` is the line that the planner
        drives along, points x, y [m] of the network, or a function of the connection that gives it: a planner that
        changes lanes where SUMO does not know it is foreseen only by that; None: SUMO's route of the ego. A planner
        outside JAX that takes longer than `act_timeout_s` over one decision has failed. `plan` is what it begins with,
        such as that of a case (`plan_of_case`); it is changed where it would miss. Raises RegentsError for values
        that cannot be meant.
        """
        forget_at_close(connection)
        self._settings = LiveSettings(replan_s, horizon_s, radius_m, keep, judged, seed)
        self._sumo, self._when, self._called = connection, attack_when, source
        self._net, self._route = Path(net) if net is not None else None, route
        self._tell = tell or _to_stderr
        self._search = Search(planner, live_config(method), act_timeout_s)
        self._moments = Moments(predictor or Mirror(), horizon_s)
        folder = Path(output) if output is not None else None
        self._first = plan
        self._keeper = CaseKeeper(self._settings, self._search.planner_name, self._search.config, folder)
        self._finder = EgoFinder(connection, ego)
        self._ego_is = ego
        self._said: set[str] = set()
        self._off: Literal["paused", "detached"] | None = None
        self.tally = Tally()
        self._forget_run()

    # --- the switch ------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """What it does now."""
        if self._off:
            return self._off
        if self.ego is None:
            return "waiting"
        return "watching" if self._attacker is None else self._attacker.state

    @property
    def adversary(self) -> str | None:
        """The vehicle that attacks now."""
        attack = self._attacker.attack if self._attacker is not None else None
        return attack.plan.adversary if attack is not None else None

    @property
    def cases(self) -> list[Scenario]:
        """Those that were kept where there is no output."""
        return self._keeper.cases

    def pause(self) -> None:
        """Give back what is held, and do nothing until `resume`."""
        if self._off is None:
            self._off = "paused"
            self._guarded(self._let_go)

    def resume(self) -> None:
        """Go on after `pause`."""
        if self._off == "paused":
            self._off, self._attacker = None, None

    def detach(self) -> None:
        """Give back what is held, for good."""
        if self._off != "detached":
            self._off = "detached"
            self._guarded(self._end)

    def cleanUp(self) -> None:  # noqa: N802
        """Called by traci when the listener is removed, or the connection closed."""
        if self._off is None and self._reader is None:
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
            for ending in (self._let_go, self._end):
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
        self._begun_s = min(self._begun_s, now)
        if self.ego is None and not self._find_ego():
            if self._reader is None and now - self._begun_s >= _PATIENCE_S:
                self._say_once(
                    f"the ego ({self._ego_is}) has not departed for {_PATIENCE_S:g} s, waiting for it (expected the id "
                    "of a vehicle, a vehicle type, a flow, or a function of the connection that returns an id)"
                )
            return
        assert self.ego is not None
        assert self._reader is not None
        frame = self._reader.frame(self.ego, now)
        if frame is None or self._jumped(frame):
            self._lose_ego(frame)
            return
        if self._attacker is None:
            self._attacker = self._new_attacker(self._reader)
        self._history.add(frame)
        self._attacker.step(frame, self._wanted)

    def _find_ego(self) -> bool:
        """Whether it is there by now."""
        self.ego = self._finder.find()
        if self.ego is not None and self._reader is None:
            self._reader = Reader(self._sumo, self._settings.radius_m, self._net, self._route)
            net = self._net or path_of(self._reader.option("net-file"))
            source = self._called or Path(self._reader.option("configuration-file") or net).name
            self._source = RecordingOrigin("sumo", source, sha256_of(net))
        return self.ego is not None

    def _new_attacker(self, reader: Reader) -> Attacker:
        """One that knows nothing of what was before."""
        host = SumoHost(self._sumo, reader)
        self._history = History(self._settings.horizon_s, reader.step_s)
        self._replanner = Replanner(host, self._search, self._moments, self._history)
        first, self._first = self._first, None
        return Attacker(host, self._replanner, self._settings.replan_s, self.tally, self._keep, first)

    def _wanted(self) -> bool:
        if self._when is None:
            return True
        return bool(self._when(self._sumo)) if callable(self._when) else self._now >= self._when

    def _jumped(self, frame: Frame) -> bool:
        """Whether it is not where its speed could have taken it."""
        if self._attacker is None or not self._history.frames:
            return False
        last = self._history.frames[-1]
        way = float(np.hypot(frame.x[0] - last.x[0], frame.y[0] - last.y[0]))
        return way > _JUMP_M + max(last.speed[0], frame.speed[0]) * (frame.time_s - last.time_s)

    def _lose_ego(self, frame: Frame | None) -> None:
        """It arrived, was removed or teleported."""
        if self.adversary is not None and frame is None:
            self._say_once(
                "the ego left the simulation during an attack; where SUMO takes vehicles away that touch, start it "
                "with --collision.action warn to see the crash"
            )
        self._let_go()
        self._attacker = None
        if frame is None:
            self.ego = None
            self._finder.start()

    def _keep(self, frame: Frame, attack: Attack, outcome: Outcome) -> None:
        """Keep the case of an attack that has ended, if that is worth it."""
        if not self._keeper.wants(attack, outcome):
            return
        assert self._reader is not None
        after = self._replanner.forecast(frame, attack.plan, TAIL_S)
        frames, reader = list(self._history.frames), self._reader
        case = self._keeper.keep(frames, reader.step_s, reader.road, self._source, attack, outcome, after)
        self.tally.cases.append(case)

    # --- the rest --------------------------------------------------------------------------------

    def _let_go(self) -> None:
        """Give back what is held."""
        if self._attacker is not None:
            self._attacker.let_go()

    def _end(self) -> None:
        """Give back all that is held: a vehicle, a subscription, the processes of a planner and of a predictor."""
        try:
            self._let_go()
            if self._reader is not None:
                self._reader.forget()
        finally:
            self._search.close()
            if isinstance(self._moments.predictor, Fork):
                self._moments.predictor.close()

    def _forget_run(self) -> None:
        """Nothing is known of the simulation yet."""
        self.ego: str | None = None
        self._reader: Reader | None = None
        self._attacker: Attacker | None = None
        self._finder.start()
        self._search.forget()
        self._moments.forget()
        self._now, self._begun_s = -np.inf, np.inf

    def _say_once(self, line: str) -> None:
        if line not in self._said:
            self._said.add(line)
            self._tell(line)


def _to_stderr(line: str) -> None:
    print(f"regents_cosim.live: {line}", file=sys.stderr)
