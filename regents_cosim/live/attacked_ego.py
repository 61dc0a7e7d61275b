"""Handles one ego of a running simulation: waits for it, watches it, and attacks it with one vehicle at a time."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from regents_cosim.cases.provenance import sha256_of
from regents_cosim.errors import SumoError, require
from regents_cosim.live.attacker import Attack, AttackCounts, Attacker
from regents_cosim.live.case_keeper import TAIL_S, CaseKeeper
from regents_cosim.live.host.coordination import Coordination
from regents_cosim.live.host.interface import Frame, History
from regents_cosim.live.host.reading import SimulationReader
from regents_cosim.live.host.sumo_routes import GivenRoute
from regents_cosim.live.host.vehicle_control import HELD_S, SumoVehicleControl
from regents_cosim.live.predict.moments import Moments
from regents_cosim.live.search.plan import Plan
from regents_cosim.live.search.plans import Search
from regents_cosim.live.search.replanner import Replanner
from regents_cosim.live.settings import LiveSettings
from regents_cosim.sources.recording import matches_vehicle
from regents_cosim.sources.windows import RecordingOrigin

Picks = str | Callable[[Any], str | None]

_NOT_ON_ROADS = ("rail", "tram", "subway", "ship", "cable_car")  # prefixes of these vehicle classes


class EgoFinder:
    """Waits for the ego, given by an id, by a type or flow (whose first vehicle is taken), or by a function."""

    def __init__(self, connection: Any, picks: Picks, is_free: Callable[[str], bool]) -> None:
        """`is_free` tells whether a vehicle may be taken as ego by its type or flow."""
        self._sumo, self._picks, self._is_free = connection, picks, is_free
        self.start()

    def start(self) -> None:
        """Check all vehicles that are present; afterwards only departing ones are checked."""
        self._looked = False

    def find(self) -> str | None:
        """The ego; None where it has not departed. Raises SumoError for a vehicle on rails or water."""
        picked = self._picks(self._sumo) if callable(self._picks) else self._by_name(self._picks)
        if picked is None or picked not in self._sumo.vehicle.getIDList():
            return None
        kind = self._sumo.vehicle.getVehicleClass(picked)
        if kind.startswith(_NOT_ON_ROADS):
            raise SumoError(f"the ego {picked!r} is of the class {kind}: not supported on rails or water")
        return picked

    def _by_name(self, name: str) -> str | None:
        """The vehicle with that id, else the first of that type or flow."""
        vehicle = self._sumo.vehicle
        there = vehicle.getIDList()
        if name in there:
            return name
        new = self._sumo.simulation.getDepartedIDList() if self._looked else there
        self._looked = True
        called = (one for one in new if matches_vehicle(name, one, vehicle.getTypeID(one)))
        return next((one for one in called if self._is_free(one)), None)


# SUMO as the host simulation of a live attack.
_STOPPED = 1  # bit of a vehicle's stop state


class SumoHost(SimulationReader):
    """A simulation that is read through TraCI or libsumo, and whose vehicles can be controlled."""

    def __init__(
        self,
        connection: Any,
        radius_m: float,
        route: GivenRoute | None,
        coordination: Coordination,
        say: Callable[[str], None],
    ) -> None:
        """As `SimulationReader`; `say` reports a line once."""
        super().__init__(connection, radius_m, route)
        self._coordination, self._say = coordination, say

    def is_at_stop(self, name: str) -> bool:
        """Whether a vehicle waits at a scheduled stop, or is parked."""
        return bool(self._sumo.vehicle.getStopState(name) & _STOPPED)

    def is_spared(self, name: str) -> bool:
        """Whether a vehicle is an ego, controlled by another adversary, or to be spared."""
        return not self._coordination.is_free(name)

    def take(self, name: str, length_m: float) -> SumoVehicleControl:
        """Take control of a vehicle; a message says if the user's code has set its speed, which cannot be restored."""
        vehicle = self._sumo.vehicle
        own = float(vehicle.getSpeedWithoutTraCI(name))  # negative where SUMO does not know it yet
        is_ours = self._coordination.held_within(HELD_S + 2.0 * self.step_s, name)
        if own >= 0.0 and own != vehicle.getSpeed(name) and not is_ours:
            self._say(
                "your code drives a vehicle that attacks: a speed that it has set ends with the attack, and places "
                "that it sets undo the attack; name vehicles that must not attack in spare"
            )
        return SumoVehicleControl(self._sumo, name, length_m, self.road, self.speed_only)


AdversaryState = Literal["waiting", "watching", "attacking", "returning"]

_GAP = 1.5  # of a step: a longer gap means that the simulation ran without this listener
_PATIENCE_S = 60.0  # of simulated time, after which a message says that the ego has not departed
_JUMP_M = 5.0  # beyond what the speed explains: the ego was teleported


@dataclass(frozen=True)
class AdversarySetup:
    """The settings that all egos of one adversary share."""

    connection: Any
    settings: LiveSettings
    coordination: Coordination
    keeper: CaseKeeper
    tally: AttackCounts
    say: Callable[[str], None]  # reports each line once
    wanted: Callable[[float], bool]  # whether an attack may begin at a time [s]
    route: GivenRoute | None = None
    source: str | None = None


class AttackedEgo:
    """Handles one ego; call `step` after every step of the simulation."""

    def __init__(
        self, setup: AdversarySetup, picks: Picks, search: Search, moments: Moments, first: Plan | None = None
    ) -> None:
        self._with, self._search, self._moments, self._first = setup, search, moments, first
        self.called = picks if isinstance(picks, str) else "that of your function"
        self._said = False  # whether the missing ego was reported
        self._leapt = False  # whether there were several steps since the last call
        self._finder = EgoFinder(setup.connection, picks, setup.coordination.is_free)
        self._forget_run()

    @property
    def state(self) -> AdversaryState:
        """The current state."""
        if self.ego is None:
            return "waiting"
        return "watching" if self._attacker is None else self._attacker.state

    @property
    def adversary(self) -> str | None:
        """The vehicle that attacks now."""
        attack = self._attacker.attack if self._attacker is not None else None
        return attack.plan.adversary if attack is not None else None

    @property
    def held(self) -> str | None:
        """The vehicle that is controlled: it attacks, or is returning."""
        return self._attacker.held if self._attacker is not None else None

    @property
    def is_missed(self) -> bool:
        """Whether no ego has departed in this run, which has made a step, and that was not reported yet."""
        return self._host is None and not self._said and self._begun_s < np.inf

    def step(self) -> None:
        """Continue after a step of the simulation."""
        now = float(self._with.connection.simulation.getTime())
        if now == self._now:
            return  # the listener was added twice
        if now < self._now:
            self._forget_run()  # another simulation on the same connection
        elif self._host is not None and now - self._now > _GAP * self._host.step_s:
            self.let_go()  # many steps at once, or another simulation with a later begin
            require(
                not self._leapt,
                f"the simulation makes steps of {self._host.step_s:g} s, and {now - self._now:g} s go by between two "
                "calls of the adversary, expected every step: call simulationStep() in a loop, without a time",
                SumoError,
            )
            self._forget_run()
            self._leapt = True
        else:
            self._leapt = False
        self._now = now
        self._begun_s = min(self._begun_s, now)
        if self.ego is None and not self._find_ego():
            if self._host is None and now - self._begun_s >= _PATIENCE_S:
                self._said = True
                self._with.say(
                    f"the ego ({self.called}) has not departed for {_PATIENCE_S:g} s, waiting for it (expected the id "
                    "of a vehicle, a vehicle type, a flow, or a function of the connection that returns an id)"
                )
            return
        assert self.ego is not None
        assert self._host is not None
        frame = self._host.frame(self.ego, now)
        if frame is None or self._jumped(frame):
            self._lose_ego(frame)
            return
        if self._attacker is None:
            self._attacker = self._new_attacker(self._host)
        self._history.frames.append(frame)
        self._attacker.step(frame, lambda: not self._leapt and self._with.wanted(now))

    def let_go(self) -> None:
        """Release the controlled vehicle, and cancel the subscription."""
        if self._attacker is not None:
            self._attacker.let_go()
        if self._host is not None:
            self._host.forget()

    def give_up(self, name: str) -> None:
        """Release that vehicle, if it is controlled, and leave it alone for a while."""
        if self._attacker is not None and self.held == name:
            self._attacker.abandon(self._now)

    def start_over(self) -> None:
        """Forget what was seen, after a pause, in which the ego may have departed."""
        self._attacker, self._leapt = None, False
        self._finder.start()

    def end(self, is_gone: bool = False) -> None:
        """Release all: the vehicle, the subscription, and the planner's process; if `is_gone`, only the process.

        `is_gone` means that the simulation was closed.
        """
        try:
            if not is_gone:
                self.let_go()
        finally:
            self._search.close()

    def _find_ego(self) -> bool:
        """Whether the ego has departed."""
        self.ego = self._finder.find()
        if self.ego is None:
            return False
        self._with.coordination.make_ego(self.ego)
        if self._host is None:
            setup, radius_m = self._with, self._with.settings.radius_m
            self._host = SumoHost(setup.connection, radius_m, setup.route, setup.coordination, setup.say)
            net = self._host.net
            source = setup.source or Path(self._host.option("configuration-file") or net).name
            self._source = RecordingOrigin("sumo", source, sha256_of(net))
        return True

    def _new_attacker(self, host: SumoHost) -> Attacker:
        """A new attacker without memory of what was before."""
        setup = self._with
        self._search.forget()
        self._history = History(setup.settings.horizon_s, host.step_s)
        self._replanner = Replanner(host, self._search, self._moments, self._history)
        first, self._first = self._first, None
        return Attacker(host, self._replanner, setup.settings.replan_s, setup.tally, self._keep, first)

    def _jumped(self, frame: Frame) -> bool:
        """Whether the ego has jumped farther than its speed allows."""
        if self._attacker is None or not self._history.frames:
            return False
        last = self._history.frames[-1]
        way = float(np.hypot(frame.x[0] - last.x[0], frame.y[0] - last.y[0]))
        return way > _JUMP_M + max(last.speed[0], frame.speed[0]) * (frame.time_s - last.time_s)

    def _lose_ego(self, frame: Frame | None) -> None:
        """The ego has arrived, was removed or was teleported."""
        if self.adversary is not None and frame is None:
            self._with.say(
                "the ego left the simulation during an attack; where SUMO takes vehicles away that touch, start it "
                "with --collision.action warn to see the crash"
            )
        self.let_go()
        self._attacker = None
        if frame is None:
            self.ego = None
            self._finder.start()

    def _keep(self, frame: Frame, attack: Attack) -> None:
        """Keep the case of a crash."""
        assert self._host is not None
        after = self._replanner.forecast(frame, attack.plan, TAIL_S)
        frames, host = list(self._history.frames), self._host
        case = self._with.keeper.keep(frames, host.step_s, host.road, self._source, attack, after)
        self._with.tally.cases.append(case)

    def _forget_run(self) -> None:
        """Forget everything about the simulation."""
        self.ego: str | None = None
        self._host: SumoHost | None = None
        self._attacker: Attacker | None = None
        self._finder.start()
        self._moments.forget()
        self._now, self._begun_s = -np.inf, np.inf
