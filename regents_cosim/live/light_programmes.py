"""Predicts the traffic lights of a running simulation from their programmes in SUMO.

A phase without a fixed length, as in actuated lights, is assumed to last.
"""

from typing import Any

from regents_cosim.live.traffic import Shows

_STATIC = 0  # SUMO's number for programmes with fixed phases
_PHASES_AHEAD = 20  # most phases ahead

_Phase = tuple[float, str, bool, int]  # seconds, letters, whether the length is certain, and index of the next phase


class LightProgrammes:
    """The programmes of one simulation. `connection` is libsumo, traci, or a connection of traci."""

    def __init__(self, connection: Any) -> None:
        self._sumo = connection
        self._step_s = float(connection.simulation.getDeltaT())  # SUMO switches in the step that begins then
        self._known: dict[tuple[str, str], list[_Phase]] = {}

    def ahead(self, light: str, letters: str, now_s: float, seconds: float) -> Shows:
        """The letters that a light, which shows `letters` now, will show for some seconds."""
        lights = self._sumo.trafficlight
        phases, number = self._phases(light, lights.getProgram(light)), int(lights.getPhase(light))
        shows = [(0.0, letters)]
        if number >= len(phases) or phases[number][1] != letters:
            return tuple(shows)  # the user's code has set the letters
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
