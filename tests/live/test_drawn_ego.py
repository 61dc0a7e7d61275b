"""Which vehicle a planner drives, where no vehicle is named."""

import math

import pytest

from regents_cosim.cases.shipped import network_config
from regents_cosim.live.episodes import DrawnEgo
from regents_cosim.simulators.sumo.process import running_sumo

RADIUS_M = 100.0
NET = network_config("merge").with_name("merge.net.xml")


def drawn(seed, options, longest_s=400.0):
    """Who is drawn, when, how many others are near, and whether it departs then."""
    with running_sumo([*options, "--step-length", "0.1"]) as sumo:
        ego = DrawnEgo(sumo, seed, RADIUS_M)
        while sumo.simulation.getTime() < longest_s and sumo.simulation.getMinExpectedNumber() > 0:
            sumo.simulationStep()
            name = ego.departed()
            if name is not None:
                where = {one: sumo.vehicle.getPosition(one) for one in sumo.vehicle.getIDList()}
                near = sum(math.dist(where[name], at) < RADIUS_M for at in where.values()) - 1
                departs = name in sumo.simulation.getDepartedIDList()
                return name, sumo.simulation.getTime(), near, departs
    return None


@pytest.mark.parametrize("network", ["crossing", "signals"])
def test_it_departs_among_others_and_seeds_differ(network):
    options = ["-c", str(network_config(network)), "--seed", "1"]
    found = [drawn(seed, options) for seed in range(6)]
    assert all(near >= 3 and departs for _, _, near, departs in found)
    assert all(at_s >= 20.0 for _, at_s, _, _ in found)
    assert len({name for name, *_ in found}) >= 3
    assert drawn(2, options) == found[2]


def routes(tmp_path, departs_s, cars=""):
    """Lorries where `cars` names the others by their numbers, else cars alone."""
    kinds = ["" if not cars or str(k) in cars.split() else 'type="lorry"' for k in range(len(departs_s))]
    each = zip(departs_s, kinds, strict=True)
    trips = "".join(
        f'<trip id="v{k}" depart="{at_s}" {kind} from="main" to="exit"/>' for k, (at_s, kind) in enumerate(each)
    )
    file = tmp_path / "few.rou.xml"
    file.write_text(f'<routes><vType id="lorry" vClass="truck"/>{trips}</routes>')
    return ["-n", str(NET), "-r", str(file)]


def test_where_few_drive_it_is_the_first_after_a_while(tmp_path):
    _, at_s, near, departs = drawn(0, routes(tmp_path, range(0, 400, 30)))
    assert near < 3
    assert departs
    assert 200.0 <= at_s <= 250.0


def test_where_no_vehicle_follows_it_is_one_on_the_road(tmp_path):
    assert drawn(0, routes(tmp_path, [5.0, 15.0]))[0] in {"v0", "v1"}
    assert drawn(0, routes(tmp_path, [1.0])) is None  # it has arrived


def test_passenger_cars_come_before_all_others(tmp_path):
    cars = {f"v{k}" for k in range(0, 120, 6)}
    many = routes(tmp_path, [1.5 * k for k in range(120)], cars=" ".join(cars).replace("v", ""))
    found = [drawn(seed, many) for seed in range(5)]
    assert {name for name, *_ in found} <= cars
    assert all(near >= 3 for _, _, near, _ in found)
    assert drawn(0, routes(tmp_path, [5.0, 15.0], cars="1"))[0] == "v1"
    assert drawn(0, routes(tmp_path, [5.0, 15.0], cars="7"))[0] in {"v0", "v1"}  # there are none
