"""The lines at which others have to let the ego pass, on the host and on the device."""

import jax.numpy as jnp
import numpy as np
import pytest
from shipped_cases import shipped_windows

from regents_cosim.mirror.lane_centres import lane_centres
from regents_cosim.routes.route import route_of
from regents_cosim.routes.yield_lines import yield_lines
from regents_cosim.verdicts.careful.lane_keeping import to_yield_line


def test_on_the_way_with_priority_all_approaches_from_the_side_have_a_line():
    window = next(one for one in shipped_windows("crossing") if yield_lines(one))
    route, lines = route_of(window), yield_lines(window)
    own = {one.lane for one in route.lanes}
    assert all(one.they_yield and not one.ego_yields for one in route.meetings)
    assert not own & lines.keys()
    targets = {link.target for lane, beyond in lines.items() if beyond == 0.0 for link in window.road.exits[lane]}
    assert {one.other for one in route.meetings} <= targets | lines.keys()


def test_an_ego_that_has_to_wait_relies_on_no_line():
    windows = [one for one in shipped_windows("roundabout") if route_of(one).meetings]
    waiting = [one for one in windows if all(met.ego_yields for met in route_of(one).meetings)]
    assert all(not yield_lines(one) for one in waiting)


def test_those_who_turn_across_on_green_wait_before_the_lane_of_the_ego_and_nobody_else_with_a_light_does():
    windows = shipped_windows("signals")
    straight = next(one for one in windows if "north_in.south_out" in one.id)
    turns = next(one for one in windows if "north_in.east_out" in one.id)
    assert not yield_lines(turns)  # it has to let the oncoming traffic pass itself
    road, lines = straight.road, yield_lines(straight)
    inside = {road.lane[name]: beyond for name, beyond in lines.items() if beyond < 0.0}
    (waiting,) = inside
    (own,) = {one.lane for one in route_of(straight).lanes if one.lane.startswith(":")}
    at = waiting.line.interpolate(waiting.length + inside[waiting])
    assert road.lane[own].line.distance(at) == pytest.approx(0.5 * road.lane[own].width, abs=0.05)
    red = {link.source for lane in lines for link in road.entries[lane]} | lines.keys()
    assert all("south" in name or name.startswith(":") for name in red)  # those from the sides have red


@pytest.mark.parametrize("network", ["crossing", "roundabout"])
def test_the_device_sees_the_same_lines(network):
    window = next(one for one in shipped_windows(network) if yield_lines(one))
    tracks = window.tracks
    there = tracks.valid & (np.arange(len(window.agents)) > 0)[:, None]
    place = [values[there] for values in (tracks.x, tracks.y, tracks.yaw, tracks.z)]
    here = to_yield_line(window, *place)
    origin = np.array([place[0].mean(), place[1].mean()])
    x, y, yaw = (jnp.asarray(values, jnp.float32) for values in (place[0] - origin[0], place[1] - origin[1], place[2]))
    device = np.asarray(lane_centres(window, origin).to_yield_line(x, y, yaw))
    near = np.abs(here - device) < 0.3
    assert (here > 0.0).any()
    assert near.mean() > 0.99
    assert ((here > 1.0) == (device > 1.0)).mean() > 0.99
