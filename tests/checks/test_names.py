"""Names from files stay in their folder, and ids can be written in every format."""

import json
import subprocess
import sys
import unittest.mock as mock
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import platoon, scene

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.cases.header import Header
from regents_cosim.cases.manifest import SuiteEntry, find_cases, load_manifest
from regents_cosim.cases.map_files import MapFiles
from regents_cosim.cases.suite import load_suite
from regents_cosim.checks.names import MOST_BYTES, distinct_word, file_name, require_file_name, require_id, word
from regents_cosim.cli import run
from regents_cosim.errors import CaseError, ScenarioError
from regents_cosim.evaluation.regression.baseline import Baseline, DriveOutcome, load_baseline
from regents_cosim.evaluation.suites.folders import check_suite, merge, write_suite
from regents_cosim.maps.roadmap import Lane
from regents_cosim.saving import SuiteWriter, save_unlisted
from regents_cosim.scenario.scenario import Agent, Signal

ANYTHING = st.text(st.characters(codec=None), max_size=260)
OUTSIDE = ["", ".", "..", ".hidden", "a/b", "/etc", "../up", "a\\b", "C:\\x", "a\0b", "a\nb", "\x1b[2J", "a\x85b",
           "\ud800", "\u2028", "n" * 201, "ü" * 101]  # fmt: skip
NO_ID = ["", "a\0b", "a\nb", "\x1b[2J", "\x7f", "\ud800", "\ufffe", "\u2029", "n" * 1001]  # fmt: skip


@pytest.mark.parametrize("name", OUTSIDE, ids=lambda name: ascii(name)[:20])
def test_a_name_that_may_leave_its_folder_is_refused_wherever_it_is_read(name):
    for refused in (
        lambda: require_file_name(name, "case id"),
        lambda: scene((0.0, 0.0, 10.0), name=name),
        lambda: SuiteEntry(name, "0" * 64),
        lambda: MapFiles(name or ".", None),
        lambda: MapFiles("good.road.json.gz", name or ".."),
        lambda: Baseline({"idm": {"mirror": {name: DriveOutcome("0", "no_collision")}}}),
    ):
        with pytest.raises(ScenarioError, match=r"expected the plain name of a file or folder"):
            refused()


@given(ANYTHING)
def test_a_name_that_is_taken_stays_in_its_folder(tmp_path_factory, name):
    folder = tmp_path_factory.getbasetemp()
    try:
        require_file_name(name, "case id")
    except ScenarioError:
        return
    place = folder / name
    assert place.resolve().parent == folder.resolve()
    temporary = place.with_name(f".{name}.01234567.old")
    temporary.mkdir()  # the file system takes it
    temporary.rmdir()


@pytest.mark.parametrize("name", NO_ID, ids=lambda name: ascii(name)[:20])
def test_an_id_that_no_format_can_hold_is_refused(name):
    for make in (
        lambda: require_id(name, "agent id"),
        lambda: Agent(name, "car", 4.0, 2.0),
        lambda: Signal(name, ((0, "r"),)),
        lambda: Lane(name, np.array([[0.0, 0.0], [1.0, 0.0]]), 3.0, 10.0),
    ):
        with pytest.raises(ScenarioError, match=" id "):
            make()


def test_ids_of_ordinary_traffic_are_taken():
    for name in ("west_in.north_out.0", "veh 12", "A/B:1", "#3", "Zürich-7", "车辆", "a|b", "\\", ".hidden", "-1"):
        assert require_id(name, "agent id") == name


@given(ANYTHING, ANYTHING, ANYTHING)
def test_ids_of_sources_are_names_of_files(first, second, third):
    made = file_name(word(first) or "sumo", "00064.8s", word(second), distinct_word(third, 40))
    assert require_file_name(made, "case id") == made


def test_names_that_fit_are_kept_and_others_stay_different():
    assert file_name("merge-00064.8s", "regents", "idm") == "merge-00064.8s-regents-idm"
    assert distinct_word("main.exit.32", 40) == "main.exit.32"
    assert len({distinct_word(name, 40) for name in ("a/b", "a b", "a_b", "a" * 50, "a" * 51)}) == 5
    long = file_name("x" * 150, "y" * 100)
    assert len(long) == MOST_BYTES
    assert long != file_name("x" * 150, "y" * 101)


# --- suites of others -------------------------------------------------------------------------


def renamed_on_disk(suite, new):
    """A suite whose only case is called `new` in its files, hashes and all."""
    case = platoon()
    folder = SuiteWriter(suite, 0).add(case)
    header = json.loads((folder / "scenario.json").read_text())
    header["id"] = new
    forged = platoon()
    object.__setattr__(forged, "id", new)
    with mock.patch.object(Header, "__post_init__", return_value=None):
        header["hash"] = content_hash(forged)
    (folder / "scenario.json").write_text(json.dumps(header))
    manifest = json.loads((suite / "suite.json").read_text())
    manifest["cases"][0]["hash"] = header["hash"]
    (suite / "suite.json").write_text(json.dumps(manifest))
    return suite


def test_merging_a_suite_never_touches_a_folder_that_a_case_names(tmp_path, capsys):
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "thesis.txt").write_text("years of work")
    SuiteWriter(tmp_path / "other", 0).add(platoon(seed=1))
    hostile = renamed_on_disk(tmp_path / "mal", str(precious))
    assert run(["suite", "merge", str(hostile), str(tmp_path / "other"), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "case id" in said
    assert "expected the plain name" in said
    assert [path.name for path in precious.iterdir()] == ["thesis.txt"]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["../away", "/tmp/away", ".", "..", ""])
def test_a_manifest_that_names_a_folder_elsewhere_is_refused(tmp_path, name):
    SuiteWriter(tmp_path / "suite", 0).add(platoon())
    manifest = json.loads((tmp_path / "suite" / "suite.json").read_text())
    manifest["cases"][0]["case"] = name
    (tmp_path / "suite" / "suite.json").write_text(json.dumps(manifest))
    for read in (
        load_manifest,
        find_cases,
        load_suite,
        lambda suite: list(check_suite(suite)),
        lambda s: merge([s, s]),
    ):
        with pytest.raises(CaseError, match="case of a suite"):
            read(tmp_path / "suite")


def test_a_map_elsewhere_is_refused(tmp_path):
    folder = save_unlisted(platoon(), tmp_path)
    header = json.loads((folder / "scenario.json").read_text())
    header["map"]["road"] = "../../secret"
    (folder / "scenario.json").write_text(json.dumps(header))
    with pytest.raises(CaseError, match=r"map '../../secret' holds a /"):
        load_case(folder)


def test_a_baseline_with_a_case_elsewhere_is_refused(tmp_path):
    entry = {"hash": "0", "outcome": "no_collision"}
    content = {"planners": {"idm": {"mirror": {"../away": entry}}}, "schema": 1}
    (tmp_path / "baseline.json").write_text(json.dumps(content))
    with pytest.raises(CaseError, match="case of a baseline"):
        load_baseline(tmp_path / "baseline.json")


# --- links ------------------------------------------------------------------------------------


@pytest.fixture
def suite_and_outside(tmp_path):
    """A suite of two cases, and the same files outside of it."""
    suite, outside = tmp_path / "suite", tmp_path / "outside"
    for folder in (suite, outside):
        writer = SuiteWriter(folder, 0)
        for seed in (0, 1):
            writer.add(platoon(seed=seed))
    return suite, outside


@pytest.mark.parametrize("what", ["platoon0", "platoon0/scenario.json", "platoon0/tracks.npz", "maps", "suite.json"])
def test_a_link_out_of_a_suite_is_not_read(suite_and_outside, what):
    suite, outside = suite_and_outside
    (suite / what).rename(suite / "moved")
    (suite / what).symlink_to(outside / what)
    with pytest.raises(CaseError, match=r"is a link that leads out of"):
        load_suite(suite)


def test_a_link_that_stays_in_its_suite_is_read(suite_and_outside):
    suite, _ = suite_and_outside
    (suite / "platoon0").rename(suite / "moved")
    (suite / "platoon0").symlink_to("moved")
    assert load_case(suite / "platoon0").id == "platoon0"


def test_a_suite_may_be_a_link_itself(suite_and_outside, tmp_path):
    (tmp_path / "link").symlink_to(suite_and_outside[0])
    assert len(load_suite(tmp_path / "link")) == 2


@pytest.mark.parametrize("what", ["platoon0", "maps"])
def test_nothing_is_written_or_deleted_through_a_link(suite_and_outside, what):
    suite, outside = suite_and_outside
    before = {path: path.read_bytes() for path in outside.rglob("*") if path.is_file()}
    (suite / what).rename(suite / "moved")
    (suite / what).symlink_to(outside / what)
    with pytest.raises(CaseError, match="is a link, never followed for writing"):
        save_unlisted(replace(platoon(), target=(1.0, 2.0)), suite)
    assert {path: path.read_bytes() for path in outside.rglob("*") if path.is_file()} == before


def test_what_a_suite_keeps_beside_its_cases_is_not_read_through_a_link(suite_and_outside, tmp_path):
    suite, _ = suite_and_outside
    (tmp_path / "secret").write_text("mine")
    (suite / "notes.md").symlink_to(tmp_path / "secret")
    write_suite(suite, load_suite(suite), 0)
    assert not (suite / "notes.md").exists() or (suite / "notes.md").is_symlink()


# --- the file system --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "words",
    [
        ["replay", "LONG"],
        ["suite", "check", "LONG"],
        ["inspect", "LONG"],
        ["record", "-c", "LONG", "-o", "x"],
        ["suite", "merge", "LONG", "LONG", "-o", "LONG"],
    ],
)
def test_names_too_long_for_the_file_system_give_one_line(words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run([word.replace("LONG", "n" * 300) for word in words]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "File name too long" in said
    assert not list(tmp_path.iterdir())


def test_the_longest_id_can_be_saved_and_replaced(tmp_path):
    long = scene((0.0, 0.0, 10.0), name="n" * MOST_BYTES)
    for _ in range(2):
        assert load_case(save_unlisted(long, tmp_path)).id == long.id


def test_names_come_without_a_simulator():
    words = "import sys, regents_cosim.checks.names; assert 'numpy' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", words], check=False).returncode == 0
