"""`regents shrink` and `regents bench cross` as people use them: in processes of their own."""

import json

import pytest
from PIL import Image
from test_cli import regents

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.cases.shipped import shipped
from regents_cosim.collisions import first_contact

SUITE = shipped("scenarios") / "quickstart"


def crashes():
    """Shipped cases that end in a collision."""
    cases = [load_case(SUITE / entry.case) for entry in load_manifest(SUITE).cases]
    return [case for case in cases if case.attack.outcome == "collision"]


def smallest():
    return min(crashes(), key=lambda case: len(case.agents))


@pytest.fixture(scope="module")
def shrunk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shrunk")
    done = regents("shrink", SUITE / smallest().id, "-o", folder, "--record", folder / "pair.png", "--json")
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


@pytest.mark.slow
def test_the_table_shows_the_case_before_and_after(shrunk):
    folder, (before, after) = shrunk
    case = load_case(folder / after["case"])
    assert after["case"] == f"{before['case']}-shrunk"
    assert (after["agents"], after["steps"]) == (len(case.agents), case.tracks.steps)
    assert after["collision_step"] == first_contact(case.agents, case.tracks)[1]
    assert after["agents"] <= before["agents"]
    assert after["steps"] <= before["steps"]
    with Image.open(folder / "pair.png") as picture:
        assert picture.width > 900


@pytest.mark.slow
@pytest.mark.parametrize("words", [(), ("--ego", "planner", "--in", "mirror")])
def test_the_shrunk_crash_happens_in_sumo_and_to_the_planner(shrunk, words):
    done = regents("replay", shrunk[0] / shrunk[1][1]["case"], *words, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)[0]["verified"]


@pytest.mark.slow
def test_what_cannot_be_shrunk(tmp_path):
    case = SUITE / smallest().id

    def refused(*words):
        done = regents(*words)
        assert done.returncode == 2
        assert list(tmp_path.iterdir()) == []
        return done.stderr

    assert "is not a folder" in refused("shrink", SUITE / "nowhere", "-o", tmp_path)
    assert "expected a name that ends in .gif" in refused("shrink", case, "-o", tmp_path, "--record", "pair.jpg")
    assert "--lead. Must be >= 0.0" in refused("shrink", case, "-o", tmp_path, "--lead", "-1")
    assert "--record shows one" in refused("shrink", SUITE, "-o", tmp_path, "--record", "pair.png")


@pytest.mark.slow
def test_adversaries_of_a_suite_among_other_planners():
    done = regents("bench", "cross", SUITE, "--planners", "idm", "--planners", "constant_velocity", "--json")
    assert done.returncode == 0, done.stderr
    rows = {row["planner"]: row for row in json.loads(done.stdout)}
    assert set(rows) == {"idm", "constant_velocity", "all"}
    assert rows["idm"]["n"] == len(crashes())
    assert rows["all"]["crashes"] <= min(rows["idm"]["crashes"], rows["constant_velocity"]["crashes"])


@pytest.mark.slow
def test_one_planner_alone_crosses_nobody():
    done = regents("bench", "cross", "--planners", "idm")
    assert done.returncode == 2
    assert "expected two or more --planners" in done.stderr
