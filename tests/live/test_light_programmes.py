"""What lights will show is what SUMO then shows, as far as their programmes have phases of a fixed length."""

import numpy as np
import pytest
from crossing_scenes import EGO, road, scenario

from regents_cosim.cases.shipped import network_config
from regents_cosim.live.host.reading import LightProgrammes
from regents_cosim.replays.sumo.replay import CaseToPlay, replay_in_sumo
from regents_cosim.scenario.scenario import Signal
from regents_cosim.simulators.sumo.process import running_sumo
from regents_cosim.system.workers import local_processes, result_of, submit

AHEAD_S, EACH_S, CYCLE_S = 20.0, 0.5, 90.0


def watched(config):
    """What the one light of a run shows, and what was expected of it, every half second."""
    showed, expected = [], []
    with running_sumo(["-c", str(config), "--step-length", "0.1"]) as sumo:
        programmes, light = LightProgrammes(sumo), sumo.trafficlight
        (name,) = light.getIDList()
        while (now := sumo.simulation.getTime()) < CYCLE_S:
            sumo.simulationStep(now + EACH_S)
            now = sumo.simulation.getTime()
            showed.append(light.getRedYellowGreenState(name))
            expected.append(programmes.ahead(name, showed[-1], now, AHEAD_S))
        light.setRedYellowGreenState(name, "G" * len(showed[-1]))
        sumo.simulationStep()
        by_hand = programmes.ahead(name, "G" * len(showed[-1]), now, 1e6)
    return showed, expected, by_hand


def metered(config, phase_s):
    """The expected times of switches, after phases of another length have replaced those that were seen."""
    with running_sumo(["-c", str(config), "--step-length", "0.1"]) as sumo:
        programmes, light = LightProgrammes(sumo), sumo.trafficlight
        (name,) = light.getIDList()
        for length_s in (None, phase_s):
            (logic,) = light.getAllProgramLogics(name)
            for phase in logic.phases if length_s else ():
                phase.duration = phase.minDur = phase.maxDur = length_s
            light.setProgramLogic(name, logic)
            sumo.simulationStep()
            now = sumo.simulation.getTime()
            shows = programmes.ahead(name, light.getRedYellowGreenState(name), now, 60.0)
    return [since_s for since_s, _ in shows]


def seen_of_replay(made):
    """What an attached observer expects at each step, and what SUMO showed."""
    expected = []

    def attach(sumo, ego):
        programmes, light = LightProgrammes(sumo), sumo.trafficlight

        def look():
            now = light.getRedYellowGreenState("centre")
            expected.append(programmes.ahead("centre", now, sumo.simulation.getTime(), 100.0))

        return look

    return replay_in_sumo(CaseToPlay(made, attach=attach)).signals, expected


@pytest.fixture(scope="module")
def in_worker():
    with local_processes(1) as pool:
        yield lambda *args: result_of(submit(pool, *args))


def after(shows, seconds):
    return [letters for since_s, letters in shows if since_s <= seconds + 1e-6][-1]


@pytest.mark.slow
def test_a_programme_of_fixed_phases_is_foreseen(in_worker):
    showed, expected, by_hand = in_worker(watched, network_config("signals"))
    assert len(set(showed)) > 2
    for k, shows in enumerate(expected):
        later = range(k, min(k + int(AHEAD_S / EACH_S), len(showed)))
        assert [after(shows, (j - k) * EACH_S) for j in later] == [showed[j] for j in later]
    assert {letters for _, letters in by_hand} == {"G" * len(showed[0])}  # lamps that the user's own code has set stay


@pytest.mark.slow
def test_phases_that_the_user_changes_are_foreseen_as_they_are(in_worker):
    lengths_s = np.diff(in_worker(metered, network_config("signals"), 3.0))[1:]
    assert len(lengths_s) > 5
    assert np.allclose(lengths_s, 3.0)


@pytest.mark.slow
def test_the_lights_of_a_case_are_shown_as_they_were_and_can_be_foreseen(in_worker):
    (known,) = {link.signal for link in road("signals").connections if link.signal}
    assert known == "centre"
    links = 1 + max(link.link for link in road("signals").connections if link.signal)
    changes = ((0, "r" * links), (7, "y" * links), (12, "G" * links))
    made = scenario(EGO, net="signals", signals=(Signal("centre", changes),))
    signals, expected = in_worker(seen_of_replay, made)
    assert signals == made.signals
    assert [letters[0] for _, letters in expected[0]] == ["r", "y", "G"]
    assert np.allclose(np.diff([since_s for since_s, _ in expected[0]])[1], 5 * made.dt)
    assert [letters for _, letters in expected[-1]] == ["G" * links]
