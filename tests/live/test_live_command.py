"""`regents live`: what it says of what cannot be meant, and one whole run."""

import json

import pytest

from regents_cosim.cases.suite import load_suite
from regents_cosim.cli.application import run as run_command


def run(capsys, *words):
    return run_command(["live", *words]), capsys.readouterr()


def test_a_configuration_that_is_missing_is_one_line(capsys, tmp_path):
    code, said = run(capsys, "-c", "nowhere.sumocfg", "-o", str(tmp_path / "suite"))
    assert code == 2
    assert said.err.count("\n") == 1


@pytest.mark.slow
def test_an_ego_that_never_departs_is_one_line(capsys, tmp_path):
    code, said = run(capsys, "-c", "shipped:crossing", "--ego", "nobody", "-o", str(tmp_path / "suite"), "--quiet")
    assert code == 2
    assert "'nobody' never departed" in said.err


@pytest.mark.slow
def test_traffic_without_an_ego_is_one_line(capsys, tmp_path):
    words = ("-c", "shipped:crossing", "-o", str(tmp_path / "suite"), "--quiet", "--", "--scale", "0")
    code, said = run(capsys, *words)
    assert code == 2
    assert "no ego found (expected vehicles that depart among others" in said.err


@pytest.mark.slow
def test_a_crash_is_a_case_that_sumo_replays(capsys, tmp_path):
    code, said = run(capsys, "-c", "shipped:crossing", "--seed", "1", "-o", str(tmp_path / "suite"), "--json")
    (row,) = json.loads(said.out)
    assert code == 0
    assert row["ended"] == "crash"
    assert row["SUMO_verified"]
    (case,) = load_suite(tmp_path / "suite")
    assert case.id == row["case"]
    assert (tmp_path / "suite" / case.id / "still.png").exists()
