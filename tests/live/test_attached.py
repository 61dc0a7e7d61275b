"""An adversary in somebody's own run of SUMO: real libsumo and traci, in processes of their own."""

import pytest
from live_runs import run

from regents_cosim.cases.suite import load_suite
from regents_cosim.replays.replay import replay_each


def fcd(tmp_path, name, by="libsumo", until_s=30.0, **how):
    file = tmp_path / f"{name}.xml"
    run(by, until_s, options=["--fcd-output", str(file), "--precision", "9"], **how)
    text = file.read_text()
    return text[text.index("<fcd-export") :]  # before it, SUMO writes the time and its options


@pytest.mark.slow
@pytest.mark.parametrize("by", ["libsumo", pytest.param("labelled", marks=pytest.mark.slow)])
def test_a_run_whose_adversary_never_attacks_is_that_without_it(tmp_path, by):
    assert fcd(tmp_path, "idle", by, adversary={"never": True}) == fcd(tmp_path, "bare", by)


@pytest.mark.slow
def test_a_paused_adversary_leaves_the_run_alone(tmp_path):
    assert fcd(tmp_path, "paused", "traci", adversary={}, paused=True) == fcd(tmp_path, "bare", "traci")


@pytest.mark.slow
@pytest.mark.parametrize("by", ["libsumo", "traci", "labelled"])
def test_what_happens_live_becomes_a_case_that_replays_to_the_same_step(tmp_path, by):
    suite = tmp_path / "suite"
    warn = ["--collision.action", "warn"]
    given = {"ego": "west_in.east_out.1", "planner": "idm", "output": str(suite)}
    found = run(by, 60.0, given, options=warn, driven="idm", until_crash=True)
    assert found["crashes"] == 1
    assert found["states"][:3] == ["waiting", "watching", "attacking"]
    assert not found["told"]
    (case,) = load_suite(suite)
    assert case.attack.outcome == "collision"
    assert case.judgement is not None
    assert case.log is not None
    (replay,) = replay_each([case], "sumo")
    assert replay.verified, replay.reason
    assert {tuple(mode) for name, mode in found["modes"].items() if name != given["ego"]} == {(31, 1621)}


@pytest.mark.slow
def test_an_ego_that_does_not_depart_is_said_once():
    found = run(until_s=70.0, adversary={"ego": "no_such_vehicle"})
    assert found["states"] == ["waiting"]
    assert len(found["told"]) == 1
    assert "no_such_vehicle" in found["told"][0]


@pytest.mark.slow
def test_a_listener_that_is_added_twice_works_once(tmp_path):
    once, twice = (run(until_s=30.0, adversary={"ego": "passenger", "planner": "observed"}, added=n) for n in (1, 2))
    assert once == twice
    assert once["attacks"]


@pytest.mark.slow
def test_an_adversary_that_the_user_removes_ends_the_attack():
    found = run(until_s=100.0, adversary={"ego": "passenger", "planner": "observed"}, remove=True)
    assert found["removed"]
    assert found["raised"] is None
    assert not found["told"]


@pytest.mark.slow
@pytest.mark.parametrize("step_s", [0.05, 0.25, 1.0])
def test_steps_may_have_any_length(tmp_path, step_s):
    options = ["--step-length", str(step_s), "--collision.action", "warn"]
    found = run(until_s=60.0, adversary={"planner": "observed", "output": str(tmp_path / "suite")}, options=options)
    assert found["raised"] is None
    assert not found["told"]
    if found["cases"]:  # that replay, whatever their step
        assert all(replay.verified for replay in replay_each(load_suite(tmp_path / "suite"), "sumo"))


@pytest.mark.slow
def test_a_planner_that_raises_ends_the_attack_and_not_the_run(tmp_path):
    file = tmp_path / "breaks.py"
    file.write_text(
        "class Breaks:\n    def reset(self, scene): pass\n    def act(self, observation): raise ValueError('broken')\n"
    )
    found = run(until_s=25.0, adversary={"planner": f"{file}:Breaks"})
    assert found["raised"] is None
    assert found["states"][-1] == "detached"
    assert len(found["told"]) == 1


@pytest.mark.slow
def test_a_mesoscopic_run_is_refused_in_one_line():
    found = run(until_s=25.0, adversary={"ego": "passenger"}, options=["--mesosim", "on"])
    assert found["states"][-1] == "detached"
    assert "mesoscopic" in found["told"][0]
    assert found["raised"] is None
