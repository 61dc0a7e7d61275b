"""What `regents record` and `regents attack` do, in Python: with planner objects, resumed, and divided."""

from dataclasses import replace

import pytest
from shipped_cases import shipped_window

from regents_cosim.attacks.presets import preset
from regents_cosim.cases.shipped import network_config
from regents_cosim.cases.suite import load_suite
from regents_cosim.errors import CaseError
from regents_cosim.planners.constant_velocity import ConstantVelocity
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.folders import attack_into, record_into
from regents_cosim.runs.shards import Shard
from regents_cosim.runs.traffic import SavedCases, Traffic
from regents_cosim.runs.window_job import AttackRun
from regents_cosim.saving import SuiteWriter
from regents_cosim.sources.sumo_config import SumoInput
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
    return AttackRun(preset("king", iterations=2), PlannerUnderTest.of(planner), judge=False, verify=False)


@pytest.fixture(scope="module")
def windows(tmp_path_factory):
    folder = tmp_path_factory.mktemp("windows")
    for name in ("one", "two"):
        SuiteWriter(folder, 0).add(replace(shipped_window("crossing"), id=name))
    return SavedCases(folder)


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
    with pytest.raises(CaseError, match="was begun with"):
        attack_into(tmp_path, run_of(ConstantVelocity()), windows)


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
