"""What comes with the package has names of its own: `shipped:merge`, `shipped:standard`."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from shipped_cases import QUICKSTART, crash_on

from regents_cosim import load_suite
from regents_cosim.cases.files import load_header
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import ALL_NETWORKS, SUITES, located, network, network_config, shipped
from regents_cosim.cli import run
from regents_cosim.errors import RegentsError
from regents_cosim.simulators.sumo.config import SumoInput, read_input
from regents_cosim.verdicts.words import verdict_words

CASE = crash_on("merge").name


def said(capsys, *words):
    """The single error line of a command that is refused."""
    assert run(list(map(str, words))) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_every_name_leads_to_what_it_says():
    for name in ALL_NETWORKS:
        assert located(Path(f"shipped:{name}")) == network_config(name) == network(name) == network(f"shipped:{name}")
        assert read_input(SumoInput(Path(f"shipped:{name}"))) == read_input(SumoInput(network_config(name)))
    for name in SUITES:
        assert find_cases(Path(f"shipped:{name}")) == find_cases(shipped("scenarios") / name)
    assert located(Path(f"shipped:quickstart/{CASE}")) == shipped("scenarios") / "quickstart" / CASE
    assert located(Path("suite")) == Path("suite")


@pytest.mark.parametrize("name", SUITES)
def test_a_crash_that_comes_with_the_package_says_whether_it_holds(name):
    crashes = [case for case in load_suite(shipped("scenarios") / name) if case.judgement]
    assert crashes
    for case in crashes:
        held = case.judgement.holds
        assert None not in (held.replayed, held.reactive), case.id
        assert (held.sumo is None) == (case.provenance.source != "sumo"), case.id


@pytest.mark.parametrize("name", ["", "x", "../..", "standard/../../..", "merge/x", "/etc"])
def test_no_name_leads_elsewhere(name):
    with pytest.raises(RegentsError, match="does not exist, (did you mean|expected one of) shipped:"):
        located(Path(f"shipped:{name}"))


@pytest.mark.slow
def test_commands_take_the_names(tmp_path, capsys):
    assert run(["record", "-c", "shipped:crossing", "--count", "1", "--end", "60", "-o", str(tmp_path / "out")]) == 0
    assert run(["suite", "check", "shipped:quickstart", "--quiet"]) == 0
    assert f"{len(find_cases(QUICKSTART))} cases checked" in capsys.readouterr().out
    assert run(["replay", f"shipped:quickstart/{CASE}", "--in", "mirror", "--json"]) == 0
    replayed = capsys.readouterr()
    assert json.loads(replayed.out)[0]["case"] == CASE
    assert verdict_words(load_header(QUICKSTART / CASE).judgement) in " ".join(replayed.err.split())
    assert run(["suite", "merge", "shipped:quickstart", str(tmp_path / "out"), "-o", str(tmp_path / "both")]) == 0


def test_they_are_listed(capsys):
    assert run(["suite", "list", "--shipped", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["name"] for row in rows] == [f"shipped:{name}" for name in (*SUITES, *ALL_NETWORKS)]
    assert "--shipped" in said(capsys, "suite", "list")


def test_what_is_not_found_names_them(tmp_path, capsys):
    missing = said(capsys, "record", "-c", "sumo_nets/nowhere.sumocfg", "-o", tmp_path / "out")
    assert "SUMO configuration not found: sumo_nets/nowhere.sumocfg" in missing
    assert "shipped:merge" in missing
    assert "shipped:standard" in said(capsys, "replay", tmp_path / "nowhere")


@pytest.mark.slow
def test_pytest_takes_them(tmp_path):
    words = ["--regents-suite", "shipped:quickstart", "--regents-planner", "idm", "--collect-only", "-q"]
    done = subprocess.run([sys.executable, "-m", "pytest", *words], cwd=tmp_path, capture_output=True, text=True)
    assert f"{len(find_cases(QUICKSTART))} tests collected" in done.stdout, done.stdout + done.stderr
