"""Searches under the law: where they may go, what they accept, and what is said of settings that do not fit."""

import functools
import subprocess
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from crossing_scenes import EGO, LANE_Y, scenario, straight
from hypothesis import given
from hypothesis import strategies as st
from jax.test_util import check_grads
from scenes import platoon
from shipped_cases import shipped_window

from regents_cosim.attacks.accept.lawful import lawful_road, under_the_law
from regents_cosim.attacks.attack import attack, attack_each
from regents_cosim.attacks.descent.actions import not_too_fast, to_actions, to_controls
from regents_cosim.attacks.descent.costs import road_deviation
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED
from regents_cosim.cli import run as regents
from regents_cosim.errors import RegentsError
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.rollout import roll_out_background
from regents_cosim.mirror.world import scene_origin, to_world
from regents_cosim.norms.grades import Conduct
from regents_cosim.norms.limits import OVER_LIMIT
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import Windows
from regents_cosim.verdicts.judge import judge

FEW = REGENTS_FOCUSED.but(iterations=40, nearest=2, starts=6)
WINDOWS = ("crossing-1", "signals-1")
NEARER_EGO = straight("ego", 10.0, LANE_Y, 0.0, 10.0)
TURN = straight("a", 60.0, 1.7, np.pi, 12.0)  # on the inner of two lanes to the west, a solid line between


def lawful_world(made, agent=1):
    return under_the_law(to_world(made), made, agent, lawful_road(made, agent))


@functools.cache
def turning_world():
    return lawful_world(scenario(EGO, TURN))


# --- the map and the top speed of one candidate --------------------------------------------------


@pytest.mark.slow
def test_its_map_ends_at_the_centre_line_and_at_a_solid_line_and_leaves_the_road_as_it_was():
    world, origin = turning_world(), scene_origin(scenario(EGO, TURN))
    y = jnp.array([[1.7, 4.9, -1.7]], jnp.float32) - jnp.float32(origin[1])
    near, far = (jnp.full((1, 3), x - origin[0], jnp.float32) for x in (15.0, 50.0))
    assert (np.asarray(world.own_road(near, y, None))[0] < 0.5).tolist() == [True, False, False]
    assert (np.asarray(world.own_road(far, y, None))[0] < 0.01).all()  # far from the ego all is road
    assert (np.asarray(world.road(near, y, None))[0] < 0.5).all()


def test_without_lanes_its_map_is_the_road():
    made = platoon()
    bare = replace(made, road=replace(made.road, lanes=()))
    world = lawful_world(bare)
    assert world.own_road is world.road
    assert np.isinf(np.asarray(world.top_speed)).all()


@pytest.mark.slow
def test_the_road_cost_under_the_law_has_the_gradient_of_finite_differences(x64):
    """The car drifts across the centre line by a variable amount."""
    world = jax.tree.map(
        lambda v: v.astype(jnp.float64) if v.dtype == jnp.float32 else v, lawful_world(scenario(NEARER_EGO, TURN))
    )
    searched = SearchedAgents.only(1, len(world.valid))
    turn = world.controls.curvature.at[1].add(1e-2)

    @jax.jit
    def cost(amount):
        controls = replace(world.controls, curvature=turn * amount)
        return road_deviation(world, world.boxes(roll_out_background(world, controls)), searched)

    assert cost(jnp.asarray(0.9)) > 0.05
    check_grads(cost, (jnp.asarray(0.9),), order=1, modes=["rev"], eps=1e-5, rtol=1e-3)


@compiled
def held_to_its_speed(world, searched, actions):
    limited = not_too_fast(actions, world, searched)
    driven = roll_out_background(world, searched.put(world.controls, to_controls(limited)))
    return limited, driven.speed


@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(0.05, 1.0))
def test_nobody_gets_faster_than_its_top_speed(seed, scale):
    world = turning_world()
    searched = SearchedAgents.only(1, len(world.valid))
    logged = searched.rows(to_actions(world.controls))
    wild = jnp.asarray(np.random.default_rng(seed).normal(0.2, scale, logged.accel.shape).clip(-1, 1), jnp.float32)
    limited, speed = held_to_its_speed(world, searched, ControlArrays(wild, logged.curvature))
    assert float(speed[1].max()) <= float(world.top_speed[1]) + 1e-2
    assert (np.asarray(limited.accel) <= np.asarray(wild) + 1e-6).all()


def test_its_top_speed_is_that_of_the_limit_or_of_its_log():
    slow_car, fast_car = (replace(TURN, speed=TURN.speed * share) for share in (1.0, 3.0))
    limits = [float(lawful_world(scenario(EGO, car)).top_speed[1]) for car in (slow_car, fast_car)]
    lane = max(lane.speed_limit for lane in scenario(EGO).road.lanes)
    assert limits == pytest.approx([OVER_LIMIT * lane, 36.0], rel=1e-3)


# --- settings that do not fit --------------------------------------------------------------------


def test_attempts_need_somewhere_to_begin():
    with pytest.raises(RegentsError, match="3 attempts need somewhere else to begin: take `starts` of 1 or more"):
        REGENTS_FOCUSED.but(starts=0, attempts=3)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("--method", "focused", "--search", "joint"),
            "adversary-may `mistakes` gives each candidate a map of its own",
        ),
        (
            ("--method", "regents", "--adversary-may", "mistakes"),
            "adversary-may `mistakes` gives each candidate a map of its own",
        ),
        (("--method", "focused", "--starts", "0"), "8 attempts need somewhere else to begin"),
        (("--method", "focused", "--starts", "-1"), "starts is -1, expected a number of 0 or more"),
    ],
)
def test_settings_that_do_not_fit_are_one_line_and_exit_code_2(tmp_path, capsys, words, said):
    code = regents(["attack", "-c", "shipped:grid", "-o", str(tmp_path / "out"), *words])
    error = capsys.readouterr().err
    assert (code, len(error.splitlines())) == (2, 1)
    assert said in error
    assert not (tmp_path / "out").exists()


# --- what is accepted ----------------------------------------------------------------------------


def check_telling(cases):
    """Check that each crash is clean, lawful as far as is known, and avoidable by the careful driver."""
    crashes = [judge(case).judgement for case in cases if case.attack.outcome == "collision"]
    for judgement in crashes:
        assert judgement.clean
        assert judgement.law.conduct is not Conduct.GROSS
        assert next(drive.avoids for drive in judgement.drivers if drive.driver == "careful")
    return len(crashes)


def searched(engine="threads"):
    windows = [shipped_window(name) for name in WINDOWS]
    return [case for some in attack_each(windows, FEW, "idm", batch=4, engine=engine) for case in some]


@pytest.fixture(scope="module")
def threads():
    return searched()


@pytest.mark.slow
def test_what_a_search_under_the_law_accepts_tells_something(threads):
    assert check_telling(threads) > 0


@pytest.mark.slow
def test_the_same_search_finds_the_same(threads):
    for one, other in zip(threads, searched(), strict=True):
        assert one.attack == other.attack
        for name in ("x", "y", "yaw", "speed"):
            np.testing.assert_array_equal(getattr(one.tracks, name), getattr(other.tracks, name))


@pytest.mark.slow
def test_threads_and_lanes_search_under_the_law_alike(threads):
    lanes = searched("batched")
    check_telling(lanes)
    assert {case.attack.case for case in threads} == {case.attack.case for case in lanes}
    outcomes = [{(c.attack.case, c.attack.outcome) for c in found} for found in (threads, lanes)]
    assert outcomes[0] == outcomes[1]


@pytest.mark.slow
def test_without_the_law_adversaries_break_it():
    windows = [shipped_window(name) for name in ("crossing-2", "signals")]
    free = FEW.but(adversary_may="anything", accept="clean", starts=0, attempts=1, sampled=0, iterations=150, nearest=4)
    laws = [judge(case).judgement.law for case in attack(windows, free, "idm") if case.attack.outcome == "collision"]
    assert any(law.conduct is Conduct.GROSS for law in laws)


TRIPS = """<routes><vType id="car" length="4.6" width="1.8"/>
{}</routes>"""


@pytest.fixture(scope="module")
def left_hand(tmp_path_factory):
    """A window of traffic on a crossing where people drive on the left."""
    import sumo

    folder = tmp_path_factory.mktemp("left")
    net, routes, config = (folder / f"left.{kind}" for kind in ("net.xml", "rou.xml", "sumocfg"))
    options = ["--grid", "--grid.number", "2", "--grid.length", "120", "--grid.attach-length", "120", "--lefthand"]
    options += ["--no-turnarounds", "--default.lanenumber", "2", "-o", str(net)]
    subprocess.run([f"{sumo.SUMO_HOME}/bin/netgenerate", *options], check=True, capture_output=True)
    ends = [("left0A0", "B0right0"), ("right0B0", "A0left0"), ("top0A1", "A0bottom0"), ("bottom1B0", "B1top1"),
            ("left1A1", "B1top1"), ("bottom0A0", "A1top0")]  # fmt: skip
    trips = "\n".join(
        f'<trip id="{i}.{k}" type="car" depart="{2.5 * k + 0.2 * i:.1f}" from="{a}" to="{b}" departLane="best" '
        'departSpeed="max"/>'
        for k in range(40)
        for i, (a, b) in enumerate(ends)
    )
    routes.write_text(TRIPS.format(trips))
    config.write_text(
        f'<configuration><input><net-file value="{net.name}"/><route-files value="{routes.name}"/></input>'
        '<time><begin value="0"/><end value="100"/></time></configuration>'
    )
    return record_sumo(SumoInput(config=config), Windows(count=2, seed=1), tell=lambda _: None)


@pytest.mark.slow
def test_on_the_left_the_law_is_kept_as_well(left_hand):
    found = list(attack(left_hand, FEW, "idm"))
    check_telling(found)
    assert any(case.attack.rollouts > FEW.steps.iterations for case in found)
    assert all(case.attack.outcome in ("collision", "no_collision", "no_candidate") for case in found)
