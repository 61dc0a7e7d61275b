"""Short forms of the endless runs of benchmarks/endurance: thousands of items are for their commands."""

import pytest

from benchmarks.endurance import dask_windows, live, takeovers
from benchmarks.endurance.attacks import run
from benchmarks.endurance.gauge import Gauge, Sample
from benchmarks.endurance.replays import play

FLAT = {"rss_kb": 1000, "children_rss_kb": 0, "fds": 7, "threads": 4, "children": 0, "files": 0}


def held(tmp_path, **growing):
    """Five samples, in which some quantities grow by as much from each to the next."""
    made = Gauge(tmp_path)
    for k in range(5):
        made.samples.append(
            Sample(items=100 * k, **{name: value + k * growing.get(name, 0) for name, value in FLAT.items()})
        )
    return made


@pytest.mark.parametrize("name", ["fds", "threads", "children", "files"])
def test_what_grows_is_found(tmp_path, name):
    assert held(tmp_path).growth(1.0) == []
    [found] = held(tmp_path, **{name: 1}).growth(1.0)
    assert found.startswith(f"{name}: {FLAT[name]} at first")


def test_memory_that_grows_is_found(tmp_path):
    leaking = held(tmp_path, rss_kb=18_500)  # as when every result of a replay is kept
    assert leaking.slope_kb() == pytest.approx(185.0)
    assert len(leaking.growth(4.0)) == 1
    assert leaking.growth(200.0) == leaking.growth(None) == []


@pytest.mark.slow
@pytest.mark.parametrize("where", ["sumo", "highway"])
def test_replays_leave_nothing(where):
    found = play(8, where, every=2, check_memory=False)
    assert (found["count"], found["failures"], found["grown"]) == (8, {}, [])
    assert found["left"] == {"children": 0, "files": 0}


@pytest.mark.slow
def test_attacks_leave_nothing():
    found = run(8, every=2, check_memory=False, most_jobs=1)
    assert (found["count"], found["failures"], found["grown"]) == (8, 0, [])


@pytest.mark.slow
def test_live_episodes_leave_nothing():
    found = live.run(4, every=1, check_memory=False, longest_s=4.0)
    assert (found["count"], found["failures"], found["grown"]) == (4, 0, [])


@pytest.mark.slow
def test_listeners_that_only_close_ends_leave_nothing():
    found = live.run(4, every=1, check_memory=False, longest_s=2.0, listeners=True)
    assert (found["ends"], found["failures"], found["grown"]) == ({"detached": 4}, 0, [])


@pytest.mark.slow
def test_vehicles_that_attacked_have_lost_nothing_and_brake_as_drivers_do():
    found = takeovers.run("crossing", attacks=2, after_s=30.0)
    assert (found["attacks"], found["given back"]) == (2, 2)
    assert (found["lost"], found["brake hard"]) == ({}, {})
    assert [line for line in found["told"] if "compiling once" not in line] == []
    assert found["arrive with us"] == found["arrive without us"]


@pytest.mark.slow
def test_windows_on_dask_are_all_done(tmp_path):
    found = dask_windows.run(tmp_path, windows=2, recorded=1, on="dask")
    assert (found["done"], found["failed"], found["exit"] in (0, 1)) == (2, 0, True)


@pytest.mark.parametrize(
    ("asked", "at_ease", "is_for_another"),
    [
        ([0.0, 6.0, 0.0], True, True),
        ([0.0, 0.0, 0.0], True, False),  # for nobody who is ahead
        ([6.0, 0.0, 0.0], True, False),  # the one who was ahead does not ask for it in that step
        ([0.0, 6.0, 0.0], False, False),  # it had to brake hard already when it was given back
    ],
)
def test_braking_for_who_comes_into_the_way_is_told_from_braking_by_our_doing(asked, at_ease, is_for_another):
    one = takeovers.Takeover("a", 0.0, {}, 4.5, speeds=[9.0, 8.6, 8.0], asked=asked, at_ease=at_ease, in_hand=False)
    assert one.is_hard
    assert one.is_for_another == is_for_another
