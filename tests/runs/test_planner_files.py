"""A planner is identified by its files, including those that they import or name."""

import pickle

import pytest

from regents_cosim.attacks.methods.presets import KING
from regents_cosim.errors import PlannerError
from regents_cosim.planners.idm import IDM
from regents_cosim.planners.names import OURS
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.planner_files import digest_of, planner_digest, planner_files
from regents_cosim.runs.window_job import AttackRun

PLANNER = """
import numpy, json
import helper
from pack.part import thing
from pack import other
WEIGHTS = "weights.bin"
def late():
    import hidden_away
class Mine: ...
"""


@pytest.fixture
def user(tmp_path, monkeypatch):
    """A user's folder with a planner, the files that it needs, and `stranger.py`, which it does not need."""
    files = {
        "planner.py": PLANNER,
        "helper.py": "x = 1",
        "hidden_away.py": "y = 1",
        "stranger.py": "z = 1",
        "weights.bin": "1234",
        "pack/__init__.py": "",
        "pack/part.py": "from . import sibling\nfrom .sibling import deep\nthing = 1",
        "pack/sibling.py": "deep = 1",
        "pack/other.py": "",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


NEEDED = {"planner.py", "helper.py", "hidden_away.py", "weights.bin"} | {
    f"pack/{name}.py" for name in ("__init__", "part", "sibling", "other")
}


@pytest.mark.parametrize("name", ["planner.py:Mine", "planner:Mine", "{at}/planner.py:Mine", "exec:python planner.py"])
def test_all_that_a_planner_imports_and_names_is_found_and_nothing_else(user, name):
    found = {path.relative_to(user).as_posix() for path in planner_files(name.format(at=user))}
    assert found == NEEDED


@pytest.mark.parametrize("name", sorted(NEEDED - {"pack/__init__.py"}))
def test_a_change_in_any_of_them_changes_the_digest(user, name):
    before = planner_digest("planner.py:Mine")
    (user / name).write_text((user / name).read_text() + "\n#")
    assert planner_digest("planner.py:Mine") != before


def test_a_package_on_the_way_to_a_relative_import_counts(user):
    for name, text in {
        "__init__": "",
        "sub/__init__": "k = 1",
        "sub/deep": "K = 2",
        "start": "from .sub.deep import K",
    }.items():
        (user / "outer" / f"{name}.py").parent.mkdir(parents=True, exist_ok=True)
        (user / "outer" / f"{name}.py").write_text(text)
    found = {path.relative_to(user).as_posix() for path in planner_files("outer.start:K")}
    assert found == {"outer/__init__.py", "outer/start.py", "outer/sub/__init__.py", "outer/sub/deep.py"}


def test_a_change_elsewhere_does_not(user):
    before = planner_digest("planner.py:Mine")
    (user / "stranger.py").write_text("z = 2")
    assert planner_digest("planner.py:Mine") == before


@pytest.mark.parametrize("name", [*OURS, "sumo", "highway:idm", "idm:time_headway_s=1.0"])
def test_ours_are_known_by_our_version(name):
    assert planner_digest(name) == ""


def test_weights_are_part_of_the_planner(user):
    before = planner_digest("aim-bev:weights.bin")
    assert before
    (user / "weights.bin").write_text("12345")
    assert planner_digest("aim-bev:weights.bin") != before


def test_what_cannot_be_read_is_left_to_who_imports_it(user):
    (user / "planner.py").write_text("import (")
    assert {path.name for path in planner_files("planner.py:Mine")} == {"planner.py"}


def test_an_object_counts_with_its_fields_and_the_files_of_its_class():
    def digest(headway):
        return digest_of(PlannerUnderTest.of(IDM(time_headway=headway)))

    assert digest(1.0) == digest(1.0) != digest(2.0)
    assert digest_of(PlannerUnderTest.of("idm")) == planner_digest("idm") == ""


def test_a_run_goes_to_workers_with_its_planner():
    run = AttackRun(KING, PlannerUnderTest.of("idm:time_headway=0.4"))
    there = pickle.loads(pickle.dumps(run))
    assert there.planner.name == run.planner.name == "idm:time_headway=0.4"
    assert there.planner.loop == run.planner.loop
    alone = PlannerUnderTest.of(Unpicklable(), own_process=False)
    with pytest.raises(PlannerError, match="cannot leave its process"):
        pickle.dumps(AttackRun(KING, alone))
    with pytest.raises(PlannerError, match="cannot be pickled"):
        digest_of(alone)


class Unpicklable:
    def reset(self, scene):
        pass

    def act(self, observation):
        pass
