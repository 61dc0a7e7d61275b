"""Runs that an adversary has to live with: other methods, modes of SUMO, planners and users that do as they like."""

import subprocess
import time
from pathlib import Path

import pytest
from live_runs import run

from regents_cosim.cases.suite import load_suite
from regents_cosim.replays.replay import replay_each

pytestmark = pytest.mark.slow
WARN = ["--collision.action", "warn"]


@pytest.mark.parametrize("method", ["regents", "king"])
def test_the_methods_of_the_papers_attack_live(tmp_path, method):
    given = {"ego": "passenger", "planner": "idm", "method": method, "output": str(tmp_path / "suite")}
    found = run(until_s=40.0, adversary=given, options=WARN)
    assert found["raised"] is None
    assert not found["told"]
    assert found["attacks"]
    cases = load_suite(tmp_path / "suite") if found["cases"] else []
    assert {case.attack.method for case in cases} <= {method}
    assert all(replay.verified for replay in replay_each(cases, "sumo"))


@pytest.mark.parametrize("option", ["--lateral-resolution", "--lanechange.duration"])
def test_where_lanes_are_left_slowly_the_speed_alone_is_ours(option):
    given = {"ego": "passenger", "planner": "observed"}
    found = run(until_s=100.0, adversary=given, options=[*WARN, option, "0.8"], until_crash=True)
    assert found["raised"] is None
    assert not found["told"]
    assert found["attacks"]
    assert found["given_back"]


def test_a_planner_that_hangs_ends_the_attack_and_not_the_run(tmp_path):
    file = tmp_path / "hangs.py"
    file.write_text(
        "import time\nclass Hangs:\n    def reset(self, scene): pass\n    def act(self, observation): time.sleep(1e3)\n"
    )
    begun = time.monotonic()
    found = run(until_s=25.0, adversary={"planner": f"{file}:Hangs", "act_timeout_s": 2.0})
    assert time.monotonic() - begun < 300.0  # it sleeps for longer
    assert found["raised"] is None
    assert found["states"][-1] == "detached"
    assert len(found["told"]) == 1


@pytest.mark.parametrize("by", ["libsumo", "traci"])
def test_a_listener_that_is_kept_after_the_run_harms_none(by):
    found = run(by, until_s=20.0, adversary={"ego": "passenger", "planner": "observed"}, after_close=True)
    assert found["raised"] is None
    assert found["state"] == "detached"
    assert len(found["told"]) <= 1


def test_an_ego_on_rails_is_refused_in_one_line(tmp_path):
    found = run(until_s=20.0, adversary={"ego": "train"}, config=str(railway(tmp_path)))
    assert found["raised"] is None
    assert found["states"][-1] == "detached"
    assert len(found["told"]) == 1
    assert "rails" in found["told"][0]


def test_an_ego_that_teleports_or_is_parked_ends_no_run():
    for change in ("teleport", "park"):
        found = run(until_s=60.0, adversary={"ego": "passenger", "planner": "observed"}, options=WARN, change=change)
        assert found["raised"] is None
        assert not found["told"]


def railway(folder: Path) -> Path:
    """A straight railway with one train."""
    (folder / "r.nod.xml").write_text('<nodes><node id="a" x="0" y="0"/><node id="b" x="2000" y="0"/></nodes>')
    (folder / "r.edg.xml").write_text('<edges><edge id="ab" from="a" to="b" numLanes="1" allow="rail"/></edges>')
    (folder / "r.rou.xml").write_text(
        '<routes><vType id="train_type" vClass="rail"/>'
        '<vehicle id="train" type="train_type" depart="1"><route edges="ab"/></vehicle></routes>'
    )
    import sumo

    netconvert = Path(sumo.SUMO_HOME) / "bin" / "netconvert"
    command = [netconvert, "-n", folder / "r.nod.xml", "-e", folder / "r.edg.xml", "-o", folder / "r.net.xml"]
    subprocess.run(command, check=True, capture_output=True)
    config = folder / "r.sumocfg"
    config.write_text(
        '<configuration><input><net-file value="r.net.xml"/><route-files value="r.rou.xml"/></input></configuration>'
    )
    return config
