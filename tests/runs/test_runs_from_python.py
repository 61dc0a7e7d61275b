"""What `regents record`, `attack` and `status` do, in Python: with planner objects, resumed, divided, and growing."""

from dataclasses import replace

import pytest
from made_crashes import MadeCrashes, braked, window
from shipped_cases import shipped_window

from regents_cosim.attacks.methods.presets import preset
from regents_cosim.cases.manifest import find_cases, load_manifest
from regents_cosim.cases.shipped import network_config
from regents_cosim.cases.suite import load_suite
from regents_cosim.errors import CaseError, RegentsError
from regents_cosim.planners.blind import ConstantVelocity
from regents_cosim.runs.behaviour_map import Archive, archive_of, crash_of
from regents_cosim.runs.folders import attack_into, grow_suite, record_into
from regents_cosim.runs.merging import merge_shards
from regents_cosim.runs.requests import WantedManoeuvres
from regents_cosim.runs.shards import Shard
from regents_cosim.runs.status import runs_in
from regents_cosim.runs.traffic import SavedCases, Traffic
from regents_cosim.runs.window_job import AttackRun
from regents_cosim.saving import SuiteWriter
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.sources.record import LogInput
from regents_cosim.system.progress import Silent


class MyPlanner(ConstantVelocity):
    """A planner of the user's, handed over as an object."""


class Listening(Silent):
    """Notes the lines that are said."""

    def __init__(self):
        self.said = []

    def say(self, text):
        self.said.append(text)


def run_of(planner):
    return AttackRun.of(planner, preset("king", iterations=2), judge=False, verify=False)


@pytest.fixture(scope="module")
def windows(tmp_path_factory):
    folder = tmp_path_factory.mktemp("windows")
    for name in ("one", "two"):
        SuiteWriter(folder, 0).add(replace(shipped_window("crossing"), id=name))
    return SavedCases(folder)


def test_traffic_at_a_path_is_known_by_its_content(tmp_path):
    log = tmp_path / "tracks.csv"
    log.write_text("id,time,x,y\n1,0,0,0\n")
    traffic = Traffic(str(log))
    assert traffic == Traffic(LogInput(log))
    before = traffic.digest()
    log.write_text("id,time,x,y\n1,0,0,1\n")
    assert traffic.digest() != before
    assert Traffic(str(network_config("merge"))) == Traffic(SumoInput(network_config("merge")))


@pytest.mark.slow
def test_a_planner_object_is_attacked_into_a_folder_and_nothing_twice(windows, tmp_path):
    run, progress = run_of(MyPlanner()), Listening()
    first = attack_into(tmp_path, run, windows, progress=progress)
    assert {case.attack.case for case in load_suite(tmp_path)} == {"one", "two"}
    assert {case.attack.planner for case in load_suite(tmp_path)} == {run.planner.name}
    assert progress.said == []
    again = attack_into(tmp_path, run_of(MyPlanner()), windows, progress=progress)
    assert progress.said == ["2 of 2 windows are done already"]
    assert again.done == first.done
    assert [(one.state, one.done, one.units) for one in runs_in(str(tmp_path))] == [("finished", 2, 2)]
    with pytest.raises(CaseError, match="was begun with"):
        attack_into(tmp_path, run_of(ConstantVelocity()), windows)


def test_a_suite_grows_by_crashes_of_a_planner_object(tmp_path):
    traffic, suite, new = (tmp_path / name for name in ("traffic", "suite", "new"))
    for number in range(4):
        SuiteWriter(traffic, 0).add(window(number))
    SuiteWriter(suite, 7).add(braked(window(9), "old", 6.0, 2.0, 0.0, spoilt=True))
    run = MadeCrashes.of(MyPlanner(), verify=False)
    growth = grow_suite(str(suite), run, SavedCases(str(traffic)), minutes=5, output=new)
    assert (growth.windows, growth.used_up) == (4, True)
    assert growth.added
    names = {one.crash.case for one in growth.added}
    assert {case.id for case in load_suite(suite)} == {"old", *names}
    assert {case.id for case in load_suite(new)} == names
    assert grow_suite(suite, run, SavedCases(traffic), minutes=5).windows == 0
    assert grow_suite(suite, MadeCrashes.of(ConstantVelocity(), verify=False), SavedCases(traffic)).windows == 4


def test_a_suite_grows_from_nothing(tmp_path):
    traffic, suite = tmp_path / "traffic", tmp_path / "new" / "suite"
    for number in range(4):
        SuiteWriter(traffic, 0).add(window(number))
    run = MadeCrashes.of("constant_velocity", verify=False)
    growth = grow_suite(suite, run, SavedCases(traffic, seed=3))
    assert {case.id for case in load_suite(suite)} == {one.crash.case for one in growth.added} != set()
    assert load_manifest(suite).seed == 3
    crashes = [crash for cases in run.attack(map(window, range(4))) for case in cases if (crash := crash_of(case))]
    assert archive_of(find_cases(suite)).elites == Archive(crashes).elites
    with pytest.raises(CaseError, match="is not a folder"):
        grow_suite(tmp_path / "other", run, SavedCases(tmp_path / "none"))
    assert not (tmp_path / "other").exists()


def test_what_cannot_be_is_refused_as_on_the_command_line(tmp_path):
    run, nothing = run_of("idm"), SavedCases(tmp_path / "none")
    with pytest.raises(RegentsError, match="expected more than 0"):
        grow_suite(tmp_path, run, nothing, minutes=0)
    with pytest.raises(RegentsError, match="chooses by the judgement"):
        grow_suite(tmp_path, run, nothing)
    with pytest.raises(RegentsError, match="unknown tag 'cut-in'"):
        WantedManoeuvres({"cut-in": 2})
    with pytest.raises(RegentsError, match="it breaks the law, expected `adversary_may` anything"):
        attack_into(tmp_path, AttackRun.of("idm", wanted=WantedManoeuvres({"wrong_way": 1})), nothing)
    with pytest.raises(CaseError, match="expected the shards of a run"):
        merge_shards(tmp_path / "merged", [tmp_path])


@pytest.mark.slow
def test_a_shard_does_its_share(windows, tmp_path):
    record = attack_into(tmp_path, run_of("constant_velocity"), windows, shard=Shard(2, 2))
    assert [unit.name for unit in record.own] == ["two"]
    assert {case.attack.case for case in load_suite(tmp_path)} == {"two"}


@pytest.mark.slow
def test_traffic_is_recorded_once(tmp_path):
    traffic = Traffic(SumoInput(network_config("crossing"), end_s=60.0), count=1)
    names = record_into(tmp_path, traffic)
    assert [case.id for case in load_suite(tmp_path)] == names
    before = (tmp_path / names[0] / "scenario.json").stat().st_mtime_ns
    assert record_into(tmp_path, traffic) == names
    assert (tmp_path / names[0] / "scenario.json").stat().st_mtime_ns == before


@pytest.mark.parametrize("routes", ["", "a.xml,b.xml"])
def test_the_identity_of_traffic_has_the_names_of_the_options(routes):
    from regents_cosim.cli.options import TrafficOptions
    from regents_cosim.cli.shared import given_traffic

    options = TrafficOptions(net=network_config("crossing"), routes=routes, begin=5.0, seed=3)
    assert given_traffic(options, ("--step-length", "0.1")).settings() == {
        **vars(options), "sumo_options": ["--step-length", "0.1"],
    }  # fmt: skip
