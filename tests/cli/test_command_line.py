"""What the command line says, and what its help leaves out."""

import json
import os
import re

import pytest
from command import regents

from regents_cosim.cases.files import load_case
from regents_cosim.cases.shipped import suite_folder
from regents_cosim.cli import run
from regents_cosim.evaluation.regression.baseline import Baseline, DriveOutcome
from regents_cosim.exports.export import export
from regents_cosim.planners.names import OURS

QUICKSTART = suite_folder("quickstart")
CASE = min(file.parent.name for file in QUICKSTART.glob("crossing-*/evasion.npz"))
DRIVEN = DriveOutcome("hash", "no_collision")


def words_of(capsys, *words):
    run([*words, "--help"])
    return set(re.findall(r"--[a-z-]+", capsys.readouterr().out))


def test_help_shows_only_options_that_do_something(capsys):
    for command in (("record",), ("attack",), ("replay",), ("bench", "table1"), ("suite", "check")):
        options = words_of(capsys, *command)
        assert not [option for option in options if option.startswith("--empty")]
        assert not [one for one in options if one.startswith("--no-")]
        assert {"--wide", "--verbose", "--log-file"} <= options
    assert "--no-verify" in words_of(capsys, "live")


@pytest.mark.parametrize("command", ["attack", "evaluate", "live"])
def test_help_names_all_planners_that_come_with_the_package(command, capsys):
    run([command, "--help"])
    assert set(OURS) <= set(re.findall(r"[\w-]+", capsys.readouterr().out))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["record", "-c", "shipped:merge", "-o", "out", "--fcd-output", "fcd.xml"], "SUMO's own options go behind --"),
        (["replay", "suite", "--fcd-output", "fcd.xml"], "see `regents replay --help`)\n"),
        (["replay", "suite", "--", "--fcd-output", "fcd.xml"], "what follows -- goes to the SUMO that `record`"),
        (
            ["attack", "suite", "-o", "out", "--", "--fcd-output", "fcd.xml"],
            "goes to SUMO, which records nothing",
        ),
        (["attack", "one", "two", "-o", "out"], "two: expected an option"),
        (
            ["record", "crossing", "-o", "out"],
            "crossing: did you mean -c shipped:crossing? (see `regents record --help`",
        ),
        (["replay", "suite", "idm"], "idm: did you mean --planner idm?"),
        (["replay", "suite", "crossing"], "crossing: expected an option"),
        (["replay", "suite", "--no-json"], "Unknown option: --no-json"),
        (["suite", "list", "suite", "--tga", "x"], "see `regents suite list --help`)\n"),
        (
            ["attack", "suite", "--spread=2", "-o", "out"],
            "; a setting of a method of your own needs --method",
        ),
    ],
)
def test_what_is_refused_and_where_it_belongs(words, said, capsys):
    assert run(words) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1


def test_an_evasion_that_keeps_its_promise_says_so(capsys):
    words = ["replay", f"shipped:quickstart/{CASE}", "--in", "mirror", "--ego", "evasion"]
    assert run(words) == 0
    said = capsys.readouterr().out
    assert "1 of 1 without a collision, as the evasion promises" in said
    assert said.count("no collision") == 2
    assert run([*words, "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["expected"], row["found"]) == (None, None)


def test_the_title_of_a_replay_says_who_drives(capsys):
    words = ["replay", f"shipped:quickstart/{CASE}", "--in", "mirror", "--planner", "idm"]
    for ego, driver in (([], "idm"), (["--ego", "planner"], "idm"), (["--ego", "track"], "its track")):
        run([*words, *ego])
        assert f"the ego driven by {driver}\n" in capsys.readouterr().out


def test_vehicle_types_that_are_missing_are_one_plain_line(tmp_path, capsys):
    case = load_case(QUICKSTART / CASE)
    export(case, "fcd", tmp_path / "fcd")
    log, net = tmp_path / "fcd" / "fcd.xml.gz", tmp_path / "fcd" / "case.net.xml.gz"
    run(["record", "--fcd", str(log), "-n", str(net), "-o", str(tmp_path / "out"), "--count", "1"])
    told = capsys.readouterr().err
    assert "no vType for" in told
    assert ".py" not in told
    assert "Warning" not in told


def test_a_planner_of_another_name_is_told_that_baselines_go_by_names():
    baseline = Baseline({"a.py:Old": {"mirror": {"case": DRIVEN}}, "idm": {"sumo": {"case": DRIVEN}}})
    told = baseline.stranger("a.py:New", "mirror")
    assert "'a.py:New'" in told
    assert "goes by the name" in told
    assert "knows a.py:Old (" in told
    assert baseline.stranger("a.py:Old", "mirror") == ""
    assert Baseline().stranger("a.py:New", "mirror") == ""


@pytest.mark.slow
def test_a_name_that_is_not_utf_8_is_one_line(tmp_path):
    folder = os.fsencode(tmp_path) + b"/caf\xe9"
    os.mkdir(folder)
    done = regents("report", QUICKSTART / CASE, "-o", os.fsdecode(folder) + "/r.html", "--quiet", code=2)
    assert re.fullmatch(r"regents: a file or folder has a name that is not UTF-8, .*: rename it\n", done.stderr)
