"""The whole tool from Python: every public name is there, typed and documented, and does what its command does."""

import inspect
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from scenes import scene

import regents_cosim
from regents_cosim import (
    Control,
    LogInput,
    RegentsError,
    SumoInput,
    attack,
    evaluate,
    load_case,
    load_suite,
    record,
    replay,
    save_case,
)
from regents_cosim.cases.suite import CaseList
from regents_cosim.errors import MissingDependencyError
from regents_cosim.evaluation.suites.folders import check_suite
from regents_cosim.evaluation.suites.ranking import rank_rows
from regents_cosim.exports.table import COLUMNS
from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario.attack_record import AttackRecord

SCENES = [scene((0, 0, 10), (60, 3.2, 8), name="free"), scene((0, 0, 10), (25, 0, 0), name="blocked")]


class Rolls:
    """Goes on as it does."""

    def reset(self, scene):
        pass

    def act(self, observation):
        return Control(0.0, 0.0)


class Stops(Rolls):
    def act(self, observation):
        return Control(-6.0, 0.0)


@pytest.mark.parametrize("name", dir(regents_cosim))
def test_every_name_is_there(name):
    assert getattr(regents_cosim, name, None) is not None or name.startswith("__")


def test_public_names_are_few_enough_to_know():
    assert len(regents_cosim.__all__) <= 45


@pytest.mark.parametrize("name", regents_cosim.__all__)
def test_public_names_are_typed_and_documented(name):
    found = getattr(regents_cosim, name)
    assert inspect.getdoc(found)
    if inspect.isfunction(found):
        signature = inspect.signature(found)
        assert signature.return_annotation is not inspect.Signature.empty
        assert all(one.annotation is not inspect.Parameter.empty for one in signature.parameters.values())


def test_a_case_is_one_line_and_a_table_in_a_notebook():
    assert repr(SCENES[0]).startswith("Scenario(id='free', agents=2, seconds=")
    assert "\n" not in repr(SCENES[0])
    assert len(repr(SCENES[0])) < 200
    assert "<th>ego</th><td>" in SCENES[0]._repr_html_()
    strange = replace(SCENES[0], agents=(replace(SCENES[0].agents[0], id="<b>"), *SCENES[0].agents[1:]))
    assert "<b>" not in strange._repr_html_()
    assert repr(SCENES[0].tracks) == f"Tracks(2 agents, {SCENES[0].tracks.steps} steps)"
    assert "lanes" in repr(SCENES[0].road)


def here(planner: object, name: str) -> regents_cosim.PlannerUnderTest:
    return regents_cosim.PlannerUnderTest.of(planner, name=name, own_process=False)


@pytest.fixture(scope="module")
def driven():
    return evaluate(SCENES, here(Rolls(), "rolls"), progress=False)


def test_a_planner_drives_cases_or_one(driven):
    assert (driven.planner, len(driven.drives), driven.rows[-1].collisions) == ("rolls", 2, 1)
    assert evaluate(SCENES[0], here(Rolls(), "rolls"), progress=False).drives[0].case == "free"


def test_results_are_data_frames(driven, monkeypatch):
    frame = driven.to_frame()
    assert list(frame.planner) == ["rolls", "rolls"]
    assert list(frame.columns) == driven.to_frame("polars").columns == list(driven.to_dict()[0])
    tracks = SCENES[0].to_frame()
    assert (len(tracks), tuple(tracks.columns)) == (int(SCENES[0].tracks.valid.sum()), COLUMNS)
    monkeypatch.setitem(sys.modules, "pandas", None)
    assert SCENES[0].to_frame().columns == SCENES[0].to_frame("polars").columns == list(COLUMNS)
    monkeypatch.setitem(sys.modules, "polars", None)
    for package, said in (("pandas", "needs pandas"), ("polars", "needs polars"), (None, "needs pandas or polars")):
        with pytest.raises(MissingDependencyError, match=said):
            driven.to_frame(package)


@pytest.mark.parametrize("package", ["pandas", "polars"])
def test_rows_of_results_are_tables_and_their_slices_too(driven, package):
    rows = rank_rows([(name, driven.drives) for name in ("a", "b", "c")])
    assert [row["planner"] for row in rows[1:].to_dict()] == list(rows[1:].to_frame(package)["planner"]) == ["b", "c"]
    assert rows._repr_html_().count("<tr>") == 1 + 3
    assert repr(rows).startswith("Rows of 3: RankRow(planner='a'")
    assert repr(rows[:0]) == "Rows of 0"


def test_suites_and_results_are_tables_in_a_notebook(driven, tmp_path):
    for one in SCENES:
        save_case(one, tmp_path)
    cases = load_suite(suite(tmp_path / "suite"))
    assert cases._repr_html_().count("<tr>") == 1 + len(cases)
    assert repr(cases).startswith(f"CaseList of {len(cases)}: Scenario(id='{cases[0].id}'")
    assert len(repr(CaseList([*cases] * 50))) <= 300
    assert list(cases[1:].to_frame().id) == [case.id for case in cases[1:]]
    assert list(cases.to_frame().id) == [case.id for case in cases]
    assert driven._repr_html_().count("<tr>") == 1 + 1
    assert "<th>planner</th>" in driven._repr_html_()


def test_a_case_has_a_picture():
    assert SCENES[1].plot().size == SCENES[0].plot().size


def test_what_is_public_is_shown_in_a_line(driven):
    values = [
        driven, driven.drives[0], driven.rows[0], replay(SCENES[0], "mirror"), SCENES[0].road,
        regents_cosim.REGENTS_FOCUSED, regents_cosim.TrainConfig(),
        regents_cosim.Waypoints(np.zeros((40, 2)), 0.1), here(Rolls(), "rolls"),
        AttackRecord("case", "king", "idm", "no_collision", 3, settings={str(n): n for n in range(40)}),
        *seen_by_a_planner(),
    ]  # fmt: skip
    for value in values:
        assert repr(value).startswith(type(value).__name__)
        assert "\n" not in repr(value)
        assert len(repr(value)) <= 300


def seen_by_a_planner() -> list[object]:
    seen: list[object] = []

    class Looks(Rolls):
        def act(self, observation):
            seen[:] = observation, observation.scene
            return super().act(observation)

    evaluate(SCENES[0], here(Looks(), "looks"), progress=False)
    return seen


def test_a_method_is_named():
    with pytest.raises(RegentsError, match=r"method 'kong' is not known: did you mean king\?"):
        list(attack(SCENES, method="kong"))
    (found,) = attack(SCENES[1], method="king", planner=here(Rolls(), "rolls"), progress=False)
    assert (found.attack.method, found.attack.outcome) == ("king", "already_colliding")


def test_paths_are_strings_too(tmp_path):
    folder = save_case(SCENES[0], tmp_path)
    assert load_case(str(folder)).id == "free"
    assert replay(str(folder), "mirror").case == "free"


def test_saved_cases_are_a_suite_that_goes_on_as_one(tmp_path):
    for one in SCENES:
        save_case(one, tmp_path)
    assert {one.id for one in load_suite(tmp_path)} == {one.id for one in SCENES}
    save_case(SCENES[0], tmp_path)
    assert len(load_suite(tmp_path)) == len(SCENES)
    assert [row.problem for row in check_suite(tmp_path)] == [""] * len(SCENES)


def test_the_version_and_the_networks_are_named():
    assert regents_cosim.__version__ == version("regents_cosim")
    assert "shipped:merge" in regents_cosim.networks()


def suite(folder: Path) -> Path:
    writer = SuiteWriter(folder, 0)
    for one in SCENES:
        writer.add(one)
    return folder


@pytest.mark.slow
def test_a_planner_is_evaluated_and_held_against_its_baseline(tmp_path):
    cases = suite(tmp_path / "suite")
    accepted = evaluate(cases, Rolls, update=True)
    assert [drive.hits for drive in accepted.drives] == ["car01", None]
    assert len(accepted.comparison.accepted) == 2
    again = evaluate(str(cases), Rolls, baseline=cases / "baseline.json", fail_on="min_ttc_s:-5%")
    assert [one.status for one in again.comparison.verdicts] == ["known_failure", "same"]
    assert (again.comparison.fails(), again.comparison.accepted) == (False, None)
    assert again.rows[-1].collisions == 1


def test_what_got_worse_is_a_regression(tmp_path):
    cases, file = load_suite(suite(tmp_path / "suite")), tmp_path / "baseline.json"
    mine = regents_cosim.PlannerUnderTest.of(Stops(), name="mine", own_process=False)
    assert len(evaluate(cases, mine, baseline=file, update=True).comparison.accepted) == 2
    worse = regents_cosim.PlannerUnderTest.of(Rolls(), name="mine", own_process=False)
    found = evaluate(cases, worse, baseline=file)
    assert found.comparison.fails()
    assert {one.case: one.status for one in found.comparison.verdicts}["blocked"] == "regression"


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"fail_on": "score:-5%"}, "add --baseline"),
        ({"update": True}, "cases in memory have no baseline of their own"),
        ({"baseline": "nowhere.json"}, "baseline not found: nowhere.json"),
    ],
)
def test_what_cannot_be_compared_is_said_before_anything_is_driven(how, said):
    with pytest.raises(RegentsError, match=said):
        evaluate(SCENES, "no such planner", **how)


@pytest.mark.slow
def test_one_function_records_all_kinds_of_traffic(tmp_path):
    (of_highway,) = record("highway:merge-v1", count=1)
    (of_sumo,) = record("shipped:merge", count=1)
    (same,) = record(SumoInput(config=regents_cosim.network_config("merge")), count=1)
    assert of_sumo == same or of_sumo.id == same.id
    assert {of_highway.provenance.source, of_sumo.provenance.source} == {"highway", "sumo"}


def test_what_is_no_configuration_is_a_log(tmp_path):
    (tmp_path / "tracks.csv").write_text("nothing\n")
    for source in (tmp_path / "tracks.csv", LogInput(tmp_path / "tracks.csv")):
        with pytest.raises(RegentsError, match=r"tracks.csv"):
            record(source)
