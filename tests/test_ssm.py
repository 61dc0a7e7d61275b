"""Our surrogate safety measures against those of SUMO's SSM device, on the same traffic."""

import xml.etree.ElementTree as ET
from collections import defaultdict
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from regents_cosim.evaluation.encounters import Way
from regents_cosim.evaluation.safety import measure_pair
from regents_cosim.frames import SumoPose, from_sumo
from regents_cosim.scenario import Agent, Tracks
from regents_cosim.sumo_process import running_sumo
from regents_cosim.workers import run_isolated

NETS = Path(__file__).parents[1] / "sumo_nets"
DT = 0.1
THRESHOLDS = {"TTC": 3.0, "DRAC": 3.0, "PET": 4.0}  # SUMO's own, but for PET (2 s)
FOLLOWING, CROSSING = {"2", "3"}, {"10", "11", "17"}  # SUMO's codes of encounters
# Nobody gives way: cars of the minor road reach the crossing at all kinds of moments.
BOLD = """<routes>
  <vType id="bold" length="4.7" width="1.8" sigma="0" speedFactor="1" jmIgnoreFoeProb="1" jmIgnoreFoeSpeed="99"
         jmIgnoreJunctionFoeProb="1" impatience="1"/>
  {}
</routes>"""


def run(options, seconds, log):
    """Drive SUMO with its SSM device; returns the traffic as rows of (vehicle, step, x, y, angle, speed), and sizes."""
    device = {
        "probability": "1",
        "measures": " ".join(THRESHOLDS),
        "thresholds": " ".join(map(str, THRESHOLDS.values())),
        "trajectories": "true",
        "file": str(log),
    }
    words = [word for name, value in device.items() for word in (f"--device.ssm.{name}", value)]
    rows, sizes = [], {}
    common = [
        "--step-length",
        str(DT),
        "--no-step-log",
        "--no-warnings",
        "--precision",
        "6",
        "--lanechange.duration",
        "3",
    ]
    with running_sumo([*options, *common, *words]) as sumo:
        for step in range(round(seconds / DT)):
            sumo.simulationStep()
            for name in sumo.vehicle.getIDList():
                at = (*sumo.vehicle.getPosition(name), sumo.vehicle.getAngle(name), sumo.vehicle.getSpeed(name))
                rows.append((name, step, *at))
                sizes[name] = (sumo.vehicle.getLength(name), sumo.vehicle.getWidth(name))
    return rows, sizes


def conflicts(log):
    """SUMO's worst value of each measure and the code of its encounter, per pair of vehicles."""
    found = defaultdict(dict)
    for conflict in ET.parse(log).getroot().iter("conflict"):
        pair = tuple(sorted((conflict.get("ego"), conflict.get("foe"))))
        for measure, tag in (("TTC", "minTTC"), ("DRAC", "maxDRAC"), ("PET", "PET")):
            item = conflict.find(tag)
            if item is not None and item.get("value") != "NA":
                worst = max if measure == "DRAC" else min
                mine = (float(item.get("value")), item.get("type"))
                found[measure][pair] = worst(found[measure].get(pair, mine), mine)
    return {
        measure: {p: v for p, v in pairs.items() if (v[0] > limit if measure == "DRAC" else v[0] < limit)}
        for (measure, limit), pairs in zip(THRESHOLDS.items(), (found[m] for m in THRESHOLDS), strict=True)
    }


def ours(rows, sizes):
    """Worst value of each of our measures, per pair that comes within 50 m."""
    tracks = defaultdict(dict)
    for name, step, x, y, angle, speed in rows:
        tracks[name][step] = (*from_sumo(SumoPose(x, y, angle), sizes[name][0]), speed)
    found = {measure: {} for measure in THRESHOLDS}
    for pair in combinations(sorted(tracks), 2):
        shared = sorted(tracks[pair[0]].keys() & tracks[pair[1]].keys())
        near = [k for k in shared if np.hypot(*np.subtract(tracks[pair[0]][k][:2], tracks[pair[1]][k][:2])) < 50.0]
        if len(near) < 2:
            continue
        first, last = near[0] - 50, near[-1] + 50
        values, valid = np.zeros((4, 2, last - first)), np.zeros((2, last - first), bool)
        for i, name in enumerate(pair):
            for k in range(first, last):
                if k in tracks[name]:
                    values[:, i, k - first], valid[i, k - first] = tracks[name][k], True
        both = Tracks(*values, valid)
        ways = [Way(Agent(name, "car", *sizes[name]), both, i, DT) for i, name in enumerate(pair)]
        measured = measure_pair(*ways, DT)
        if measured.pet is not None:
            found["PET"][pair] = measured.pet
        for measure, series, worst in (("TTC", measured.ttc, np.nanmin), ("DRAC", measured.drac, np.nanmax)):
            if not np.isnan(series).all():
                found[measure][pair] = float(worst(series))
    return found


def agreement(sumo, mine, types):
    """Ratio of our value to SUMO's for each of its conflicts of some types; 0 where we have none."""
    return {p: mine.get(p, 0.0) / v for p, (v, code) in sumo.items() if code in types and v > 0.0}


def follow_traffic(folder):
    log = folder / "ssm.xml"
    rows, sizes = run(["-c", str(NETS / "signals" / "signals.sumocfg")], 120.0, log)
    return conflicts(log), ours(rows, sizes)


def cross_traffic(folder):
    cars = [
        (30.0 * i + start, f'<vehicle id="{name}{i}" type="bold" depart="{30.0 * i + start}" departSpeed="max">'
         f'<route edges="{edges}"/></vehicle>')
        for i in range(30)
        for name, edges, start in (("main", MAIN, 8.0), ("minor", MINOR, 0.5 * i))
    ]  # fmt: skip
    routes, log = folder / "bold.rou.xml", folder / "ssm.xml"
    routes.write_text(BOLD.format("\n".join(text for _, text in sorted(cars))))
    net = NETS / "crossing" / "crossing.net.xml"
    rows, sizes = run(["-n", str(net), "-r", str(routes), "--collision.action", "none"], 930.0, log)
    return conflicts(log), ours(rows, sizes)


MAIN = "west_in west_stop east_out"
MINOR = "south_in south_stop north_out"


@pytest.fixture(scope="module")
def following(tmp_path_factory):
    return run_isolated(follow_traffic, tmp_path_factory.mktemp("following"))


@pytest.fixture(scope="module")
def straight_across(tmp_path_factory):
    return run_isolated(cross_traffic, tmp_path_factory.mktemp("crossing"))


def within_five_percent(ratios):
    return np.mean([abs(ratio - 1.0) <= 0.05 for ratio in ratios.values()])


def test_followers_have_sumos_time_to_collision(following):
    sumo, mine = following
    ratios = agreement(sumo["TTC"], mine["TTC"], FOLLOWING)
    assert len(ratios) >= 30
    assert within_five_percent(ratios) >= 0.95
    # What only we find is a leader that turns off, which SUMO forgets before its rear has left the lane, or a crossing.
    only_ours = [pair for pair, value in mine["TTC"].items() if value < THRESHOLDS["TTC"] and pair not in sumo["TTC"]]
    assert len(only_ours) <= 0.15 * len(ratios)


def test_followers_have_sumos_deceleration_to_avoid_a_crash(following):
    sumo, mine = following
    ratios = agreement(sumo["DRAC"], mine["DRAC"], FOLLOWING)
    assert len(ratios) >= 3
    assert within_five_percent(ratios) == 1.0


def test_ways_that_cross_have_sumos_post_encroachment_time(straight_across):
    sumo, mine = straight_across
    ratios = agreement(sumo["PET"], mine["PET"], CROSSING)
    assert len(ratios) >= 10
    assert within_five_percent(ratios) == 1.0
    assert {pair for pair, value in mine["PET"].items() if 0.0 < value < THRESHOLDS["PET"]} == set(ratios)


def test_ways_that_cross_have_sumos_time_to_collision(straight_across):
    sumo, mine = straight_across
    ratios = agreement(sumo["TTC"], mine["TTC"], CROSSING)
    assert ratios
    assert within_five_percent(ratios) == 1.0
