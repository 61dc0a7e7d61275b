"""Several adversaries, and several egos, in one run of SUMO: they know each other."""

import pytest
from live_runs import run as attached
from live_runs import running

from regents_cosim.cases.shipped import network


def run(what):
    found = running("several_adversaries.py").run([str(network("crossing")), what])
    assert not found["told"]
    assert {tuple(modes) for modes in found["modes"]} == {(31, 1621)}  # as SUMO has them: all were given back
    assert found["left"] == 0  # a detached listener leaves
    return found


@pytest.mark.slow
def test_a_vehicle_is_taken_by_one_alone():
    found = run("one vehicle")
    assert found["held"] == [[found["names"][2]], []]


@pytest.mark.slow
def test_a_vehicle_that_was_just_given_back_is_not_taken_for_one_that_the_user_drives():
    found = run("one after the other")  # told nothing
    assert found["held"] == [[found["names"][2]]] * 2


@pytest.mark.slow
def test_the_ego_of_another_is_left_alone():
    assert run("ego of another")["held"] == [[], []]


@pytest.mark.slow
def test_a_vehicle_that_becomes_an_ego_is_given_up():
    found = run("ego that comes later")
    taken = found["names"][2]
    assert found["held"] == [[taken]]
    assert (found["then"], found["egos"]) == ([], [taken])


@pytest.mark.slow
def test_one_adversary_has_several_egos_and_takes_none_of_them():
    found = run("two egos")
    assert found["egos"] == found["names"][:2]
    assert found["held"] == [[]]


@pytest.mark.slow
def test_egos_of_one_type_are_different_vehicles():
    egos = run("two of a type")["egos"]
    assert len(egos) == len(set(egos)) == 2


SPARED = ["id", *(pytest.param(by, marks=pytest.mark.slow) for by in ("type", "flow", "function", "spared by another"))]


@pytest.mark.slow
@pytest.mark.parametrize("by", SPARED)
def test_what_is_spared_is_left_alone(by):
    assert all(held == [] for held in run(by)["held"])


@pytest.mark.slow
def test_two_egos_are_attacked_in_one_run_and_all_is_given_back():
    given = {"ego": ["passenger", "passenger"], "planner": "observed"}
    found = attached("libsumo", 25.0, given, options=["--collision.action", "warn"])
    assert found["given_back"]
    assert found["raised"] is None
    assert not found["told"]
    held = [modes for modes in found["modes"].values() if tuple(modes) != (31, 1621)]
    assert len(held) <= found["attacks"] - found["given_back"] <= 2  # what is in hand when the run ends
