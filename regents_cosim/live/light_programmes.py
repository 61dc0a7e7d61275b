"""What the lights of a running simulation will show: SUMO switches them by programmes, which it can be asked for.

A phase whose length is not fixed, as with lights that wait for vehicles, is taken to last.
"""

from typing import Any

from regents_cosim.live.traffic import Shows

_STATIC = 0  # how SUMO numbers programmes whose phases all have a fixed length
_PHASES_AHEAD = 20  # at most

_Phase = tuple[float, str, bool, int]  # seconds, letters, whether that long for certain, and which one follows


class LightProgrammes:
    """Those of one simulation. `connection` is libsumo, traci, or a connection of traci's."""

    def __init__(self, connection: Any) -> None:
        self._sumo = connection
        self._step_s = float(connection.simulation.getDeltaT())  # SUMO switches in the step that begins then
        self._known: dict[tuple[str, str], list[_Phase]] = {}

    def ahead(self, light: str, letters: str, now_s: float, seconds: float) -> Shows:
        """What a light that shows `letters` now will show for so many seconds."""
        lights = self._sumo.trafficlight
        phases, number = self._phases(light, lights.getProgram(light)), int(lights.getPhase(light))
        shows = [(0.0, letters)]
        if number >= len(phases) or phases[number][1] != letters:
            return tuple(shows)  # the user's own code has set the lamps
        at_s = float(lights.getNextSwitch(light)) - now_s + self._step_s
        while phases[number][2] and 0.0 < at_s < seconds and len(shows) < _PHASES_AHEAD:
            number = phases[number][3]
            shows.append((at_s, phases[number][1]))
            at_s += phases[number][0]
        return tuple(shows)

    def _phases(self, light: str, programme: str) -> list[_Phase]:
        if (light, programme) not in self._known:
            logics = self._sumo.trafficlight.getAllProgramLogics(light)
            logic = next((one for one in logics if one.programID == programme), None)
            self._known[light, programme] = [] if logic is None else _phases_of(logic)
        return self._known[light, programme]


def _phases_of(logic: Any) -> list[_Phase]:
    found = []
    for index, phase in enumerate(logic.phases):
        fixed = logic.type == _STATIC or phase.minDur == phase.maxDur == phase.duration
        following = phase.next[0] if phase.next else (index + 1) % len(logic.phases)
        found.append((float(phase.duration), str(phase.state), fixed and len(phase.next) < 2, int(following)))
    return found
