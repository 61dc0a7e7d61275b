"""What the pictures of the gallery claim, and the command that makes them."""

import json
import re
import subprocess
import sys

import jax
import numpy as np
import pytest
from PIL import Image
from places import ROOT

from benchmarks.gallery.chart import Line, draw_chart
from benchmarks.gallery.exhibits import ExhibitRun, exhibits
from benchmarks.gallery.gradient_field import YAWS_DEG, gradient_field
from regents_cosim.attacks.accept.rules import diverging_in_front, mostly_behind
from regents_cosim.cases.suite import load_suite
from regents_cosim.cli import run as regents
from regents_cosim.mirror.world import to_world
from regents_cosim.verdicts.clean import flaws

pytestmark = pytest.mark.slow  # the figures take a minute


def command(*words):
    asked = [sys.executable, "-m", "benchmarks", "gallery", *map(str, words)]
    done = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True)
    assert "Traceback" not in done.stderr, done.stderr
    return done


@pytest.fixture(scope="module")
def gallery(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made") / "gallery"
    done = command("-o", folder, "--json")
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


@pytest.fixture(scope="module")
def runs(gallery):
    """What the command found, exhibit by exhibit, read from its cases."""
    cases = load_suite(gallery[0] / "cases")
    return {
        exhibit.name: ExhibitRun(exhibit, {c.attack.method: c for c in cases if c.attack.case == exhibit.name})
        for exhibit in exhibits()
    }


@pytest.fixture(scope="module")
def fields():
    return [gradient_field(np.deg2rad(degrees)) for degrees in YAWS_DEG]


def outcome(run, method):
    return run.attacked[method].attack.outcome


# --- gradients around the ego -----------------------------------------------------------------


def test_behind_the_ego_everything_converges(fields):
    for field in fields:
        assert field.behind.sum() == 42
        assert field.converges[field.behind].all()


def test_in_front_descent_brakes(fields):
    for field in fields:
        assert (field.accel[field.ahead > 12] < 0).all()


def test_the_red_zone_is_where_the_steering_leads_away(fields):
    for field in fields:
        assert field.red.sum() == (12 if field.yaw else 0)
        assert field.leads_away[field.red].all()
        assert (field.left[field.leads_away & ~field.red] == 0).all(), "the others lie on the edge of the zone"


def test_the_field_is_its_own_mirror_image(fields):
    left, _, right = fields
    there = {(a, -b): k for a, b, k in zip(right.ahead, right.left, right.curvature, strict=True)}
    mirrored = [-there[place] for place in zip(left.ahead, left.left, strict=True)]
    assert left.curvature == pytest.approx(mirrored, rel=1e-3, abs=1e-2 * np.abs(left.curvature).max())


# --- the four failures ------------------------------------------------------------------------


def test_king_steers_away_who_is_turned_away_in_front(runs):
    run = runs["front_divergence"]
    world = to_world(run.exhibit.scenario)
    ego = jax.tree.map(lambda values: values[0], world.log)
    assert diverging_in_front(ego, world.log, world.valid)[1]
    assert outcome(run, "king") == "no_collision"
    assert run.turned_deg("king", "ahead") > 60
    assert run.aside("ahead", "king") > run.aside("ahead") + 1.0
    assert run.gap("king").min() > 3.0


def test_regents_cancels_that_steering_and_hits(runs):
    run = runs["front_divergence"]
    attacked = run.attacked["regents"]
    assert outcome(run, "regents") == "collision"
    assert run.turned_deg("regents", "ahead") == pytest.approx(7.0, abs=0.5)
    assert attacked.tracks.speed[1, attacked.collision.step] < 0.5
    assert flaws(attacked) == ()


def test_king_pulls_a_follower_into_the_ego(runs):
    run = runs["rear_end"]
    hit = run.attacked["king"].collision
    assert (hit.agent, hit.collision_type) == ("follower", "rear_end_by_adversary")
    assert mostly_behind(to_world(run.exhibit.scenario))[2]


def test_regents_takes_another_than_the_follower(runs):
    run = runs["rear_end"]
    attacked = run.attacked["regents"]
    assert attacked.attack.candidates == ("ahead",)
    assert (attacked.collision.agent, attacked.collision.collision_type) == ("ahead", "rear_end_by_ego")
    assert flaws(attacked) == ()


@pytest.mark.parametrize("method", ["king", "regents"])
def test_the_minimum_over_candidates_is_a_trap(runs, method):
    run = runs["minimum_trap"]
    attacked = run.attacked[method].attack
    assert attacked.outcome == "no_collision"
    assert attacked.candidates == ("ahead", "neighbour")
    assert max(attacked.cost_history["ego"]) < 0.5 * run.gap().min(), "the neighbour stays the nearest"
    assert run.moved(method, "ahead") < 0.01
    assert run.moved(method, "neighbour") > 1.0


def test_a_search_per_candidate_escapes_the_trap(runs):
    attacked = runs["minimum_trap"].attacked["focused"]
    assert attacked.collision.agent == "ahead"
    # The kind hangs on rounding, and so on the processor: a corner meets a corner.
    assert attacked.collision.collision_type in ("side_swipe", "rear_end_by_ego")
    assert flaws(attacked) == ()


@pytest.mark.parametrize("method", ["king", "regents"])
def test_the_mean_over_time_prefers_staying_close(runs, method):
    run = runs["averaged_distance"]
    assert outcome(run, method) == "no_collision"
    assert run.gap(method).mean() < run.gap().mean() - 2.0
    assert run.gap(method).min() > run.gap().min() + 2.0


def test_a_soft_minimum_hits_although_the_mean_rises(runs):
    run = runs["averaged_distance"]
    assert outcome(run, "focused") == "collision"
    assert run.gap("focused").mean() > run.gap().mean() + 2.0
    assert flaws(run.attacked["focused"]) == ()


# --- the folder -------------------------------------------------------------------------------


def test_the_page_shows_every_picture_and_names_every_case(gallery):
    folder, rows = gallery
    page = (folder / "README.md").read_text()
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+\.png)\)", page)
    assert sorted(pictures) == sorted(path.name for path in folder.glob("*.png"))
    for name in pictures:
        with Image.open(folder / name) as picture:
            assert picture.width == 1200
    linked = re.findall(r"\]\(cases/([^)]+)\)", page)
    assert sorted(linked) == sorted(row["case"] for row in rows)
    assert all((folder / "cases" / name / "scenario.json").is_file() for name in linked)


def test_the_page_says_what_the_runs_found(gallery, runs):
    page = (gallery[0] / "README.md").read_text()
    for run in runs.values():
        assert run.exhibit.lesson(run) in page
        for method in run.attacked:
            assert f"| {run.iterations(method)} | {run.gap(method).mean():.1f} m |" in page


def replayed(capsys, *words):
    assert regents(["replay", *map(str, words), "--in", "mirror", "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_its_cases_replay_in_the_mirror(gallery, capsys):
    rows = replayed(capsys, gallery[0] / "cases")
    assert len(rows) == 10
    assert all(row["verified"] for row in rows)


def test_and_in_closed_loop(gallery, capsys):
    (row,) = replayed(capsys, gallery[0] / "cases" / "rear_end-regents-log_replay", "--ego", "planner")
    assert row["found"] == row["expected"]
    assert row["found"].startswith("ahead at step")


def test_a_folder_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    done = command("-o", tmp_path / "file")
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert "cannot write to" in done.stderr


# --- the chart --------------------------------------------------------------------------------


def test_a_chart_shows_each_line_where_its_values_are():
    line = Line("flat", np.full(11, 5.0), 1.0, (200, 0, 0), 3.0)
    picture = np.asarray(draw_chart("title", "x", [line], (400, 200), 2).finish()).astype(int)
    red = (picture[60:, :, 0] > 150) & (picture[60:, :, 1] < 60)
    rows = np.flatnonzero(red.any(axis=1))
    assert red.sum() > 900, "a line from one side of the plot to the other"
    assert np.ptp(rows) <= 4, "level"


@pytest.mark.parametrize("values", [[0.0], [0.0, 0.0], [1e-6, 2e-6], [3.0, 12345.0]])
def test_a_chart_takes_any_values(values):
    assert draw_chart("t", "x", [Line("a", np.array(values), 0.1, (0, 0, 0))], (300, 200), 1).size == (300, 200)
