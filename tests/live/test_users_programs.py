"""Programs of users that an adversary joins: they get what they get without it, or are told what is wrong."""

import pytest
from live_runs import running

from regents_cosim.cases.shipped import network

pytestmark = pytest.mark.slow


def run(program, *more):
    return running("users_program.py", "traci").run([program, str(network("crossing")), *more])


def test_the_users_subscription_to_what_is_near_the_ego_tells_the_same_and_stays():
    found = run("subscribes")
    assert not found["told"]
    assert found["most"] > 2  # others are beyond
    assert found["own"]
    assert found["near"]
    assert found["left"]


def test_the_users_subscription_to_what_is_near_the_lane_of_the_ego_stays():
    assert run("adds") == {"told": [], "left": True}


def test_the_surroundings_that_are_subscribed_to_are_those_that_sumo_tells():
    assert run("follows") == {"wrong": 0}


def test_what_the_user_changes_of_vehicles_and_roads_counts_from_the_next_plan_on():
    assert run("changes") == {"length_m": 9.0, "max_speed_m_s": 3.0, "limit_m_s": 4.0}


def test_an_adversary_stays_with_its_simulation_where_the_user_switches_to_another():
    assert run("switches") == {"told": [], "found": True}


def test_many_steps_at_once_are_refused_in_one_line_and_leave_the_vehicles_as_they_are():
    found = run("leaps")
    (line,) = found["told"]
    assert "simulationStep() in a loop, without a time" in line
    assert (found["state"], found["modes"], found["attacks"]) == ("detached", [31], 0)


def test_steps_that_go_by_in_pauses_are_no_leaps():
    assert run("pauses") == {"told": [], "state": "watching"}


def test_an_ego_that_departs_in_a_pause_is_found_and_no_subscription_is_left():
    assert run("departs") == {"told": [], "first": True, "left": []}


@pytest.mark.parametrize("where", ["attack_when", "tell"])
@pytest.mark.parametrize(("how", "state"), [("pause", "paused"), ("detach", "detached")])
def test_no_vehicle_stays_controlled_where_a_function_of_the_user_ends_the_attack(how, state, where):
    assert run("ends", f"{how} {where}") == {"told": where == "tell", "state": state, "same": True}


def test_that_the_user_drives_a_vehicle_that_attacks_is_said_and_what_the_user_sets_of_it_stays():
    found = run("commands")
    assert found["held"]
    (line,) = found["told"]
    assert "spare" in line
    assert found["found"] == [7, 1621, 1, 2, 3, 255]


def test_an_ego_is_missed_in_runs_that_make_steps():
    assert run("looks")["told"] == ["the ego (that of your function) never departed: nothing was attacked"]


def test_a_state_of_the_simulation_may_be_loaded_after_a_pause(tmp_path):
    assert run("restores", str(tmp_path / "state.xml")) == {"told": [], "held": True, "modes": [31, 1621]}
