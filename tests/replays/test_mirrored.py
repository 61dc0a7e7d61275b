"""Left-hand traffic is right-hand traffic in a mirror: what is said of a crash is the same there.

And what is said where a map or a log tells little.
"""

import random
import subprocess
from dataclasses import replace

import numpy as np
import pytest
import sumolib
from avoidable_scenes import braking_lead
from mirror_drives import replay_in_mirror
from places import ROOT
from two_car_scenes import transformed

from regents_cosim.cases.suite import load_suite
from regents_cosim.cli import run
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.norms.grades import Conduct
from regents_cosim.planners.find import find_attribute
from regents_cosim.routes.route import route_into_gaps
from regents_cosim.verdicts.judge import judge

QUICKSTART = ROOT / "scenarios" / "quickstart"


def said(case):
    """What does not depend on the side of the road."""
    found = judge(replace(case, judgement=None, evasion=None)).judgement
    offences = [[(one.name, one.time_s) for one in side] for side in (found.law.adversary, found.law.ego)]
    drivers = [(drive.driver, drive.avoids, drive.perceives_s, drive.acts_s) for drive in found.drivers]
    return found.flaws, offences, found.law.unknown, drivers, found.fault.at_fault, found.telling


def crashes():
    """Of the shipped cases one of each place, their maps without networks."""
    cases = [case for case in load_suite(QUICKSTART) if case.collision]
    places = {case.id.split("-")[0]: case for case in reversed(cases)}
    return [replace(case, road=replace(case.road, sumo_net=None)) for case in places.values()]


@pytest.mark.slow
def test_every_crash_in_left_hand_traffic_is_judged_as_its_mirror_image():
    for case in crashes():
        assert said(transformed(case, 0.0, 0.0, 0.0, -1)) == said(case), case.id


def test_a_map_without_lanes_leaves_it_open_whether_a_crash_tells_something():
    attacked = braking_lead(35.4)
    judged = judge(replace(attacked, road=RoadMap((), (), attacked.road.drivable))).judgement
    assert judged.law.conduct is Conduct.UNKNOWN
    assert {"oncoming_lanes", "red_light", "gives_no_way"} <= set(judged.law.unknown)
    assert judged.telling is None or not judged.clean
    assert judged.careful is not None


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["careful", "idm"])
def test_planners_drive_without_lanes_and_without_a_route(planner):
    attacked = braking_lead(35.4)
    bare = replace(attacked, road=RoadMap((), (), attacked.road.drivable)).before_attack()
    assert not route_into_gaps(bare).lights
    assert find_attribute(planner) is not None
    assert np.isfinite(replay_in_mirror(bare, planner).x).all()


def left_hand_town(folder):
    """A grid of two lanes each way, in which one drives on the left, and traffic across it."""
    import sumo

    net = folder / "left.net.xml"
    options = "--grid --grid.number 3 --grid.length 90 --grid.attach-length 70 --no-turnarounds --seed 1 --lefthand"
    options += " --default.lanenumber 2 --tls.guess true"
    made = [f"{sumo.SUMO_HOME}/bin/netgenerate", *options.split(), "-o", str(net)]
    subprocess.run(made, check=True, capture_output=True)
    edges = [edge for edge in sumolib.net.readNet(str(net)).getEdges() if not edge.getFunction()]
    begins, ends = (
        [edge for edge in edges if node(edge).getType() == "dead_end"]
        for node in (sumolib.net.edge.Edge.getFromNode, sumolib.net.edge.Edge.getToNode)
    )
    rng, trips, time = random.Random(1), list[str](), 0.0
    while time < 200.0:
        begin, end = rng.choice(begins), rng.choice(ends)
        time += rng.expovariate(0.7)
        if begin.getFromNode() is not end.getToNode():
            way = f'from="{begin.getID()}" to="{end.getID()}"'
            trips.append(f'<trip id="v{len(trips)}" depart="{time:.1f}" {way} departSpeed="max"/>')
    (folder / "left.rou.xml").write_text("<routes>\n" + "\n".join(trips) + "\n</routes>\n")
    (folder / "left.sumocfg").write_text(
        '<configuration><net-file value="left.net.xml"/><route-files value="left.rou.xml"/>'
        '<begin value="0"/><end value="200"/><step-length value="0.1"/></configuration>'
    )
    return folder / "left.sumocfg"


@pytest.mark.slow
def test_left_hand_traffic_is_recorded_attacked_judged_and_replayed(tmp_path):
    town = left_hand_town(tmp_path)
    attack = ["attack", "-c", str(town), "--count", "2", "--seed", "3", "--adversaries", "one", "--nearest", "3"]
    assert run([*attack, "--no-pictures", "-o", str(tmp_path / "cases")]) == 0
    assert run(["replay", str(tmp_path / "cases")]) == 0
    found = [case.judgement for case in load_suite(tmp_path / "cases") if case.judgement]
    assert found
    for judgement in found:
        assert judgement.law.conduct is not Conduct.UNKNOWN
        assert "oncoming_lanes" not in judgement.law.unknown
