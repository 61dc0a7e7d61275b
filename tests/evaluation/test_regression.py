"""What a regression is: thresholds, verdicts, baselines on disk; and `regents evaluate --baseline`."""

import json
import math
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import regression_cases
from hypothesis import given
from hypothesis import strategies as st
from places import SUPPORT

from regents_cosim.cases.files import load_case
from regents_cosim.cli import run
from regents_cosim.errors import CaseError, RegentsError
from regents_cosim.evaluation.drives.metrics import COMPARED
from regents_cosim.evaluation.regression.baseline import (
    Baseline,
    DriveOutcome,
    load_baseline,
    require_one_home,
    save_baseline,
    update_baseline,
)
from regents_cosim.evaluation.regression.comparison import changes, explain, how_to_accept, judge_drive, markdown
from regents_cosim.evaluation.regression.evaluate import evaluate as drive
from regents_cosim.evaluation.regression.thresholds import parse_thresholds
from regents_cosim.evaluation.suites.harmless import weakened

SAFE = DriveOutcome(
    "a" * 64, "no_collision", metrics={"collision": 0.0, "min_ttc_s": 2.0, "max_drac_m_s2": 1.0, "score": 1.0}
)
CRASH = DriveOutcome(
    "a" * 64, "collision", "car02", 48, 4.8, "t_bone", {"collision": 1.0, "min_ttc_s": 0.0, "score": 0.3}
)
REAR_ENDED = DriveOutcome("a" * 64, "rear_ended", "car02", 48, 4.8, "rear_end_by_adversary", SAFE.metrics)
FAILED = DriveOutcome("a" * 64, "planner_error", error="raised ValueError")


def with_metric(driven, **metrics):
    return replace(driven, metrics={**driven.metrics, **metrics})


# --- thresholds -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("expression", "before", "now", "worse"),
    [
        ("min_ttc_s:-5%", 2.0, 1.9, False),
        ("min_ttc_s:-5%", 2.0, 1.89, True),
        ("min_ttc_s:-0.5", 2.0, 1.5, False),
        ("min_ttc_s:-.5", 2.0, 1.4, True),
        ("min_ttc_s:-5%", 2.0, None, False),
        ("min_ttc_s:-5%", None, 9.0, True),
        ("min_ttc_s:-5%", None, None, False),
        ("max_drac_m_s2:+10%", 1.0, 1.1, False),
        ("max_drac_m_s2:+10%", 1.0, 1.2, True),
        ("max_drac_m_s2:+0.5", None, 0.6, True),
        ("collision:+0", 0.0, 1.0, True),
        ("collision:+0", 1.0, 1.0, False),
    ],
)
def test_what_a_threshold_allows(expression, before, now, worse):
    (threshold,) = parse_thresholds(expression)
    said = threshold.violated({threshold.metric: before}, {threshold.metric: now})
    assert bool(said) == worse
    assert said.startswith(expression) or not worse


@given(st.sampled_from(sorted(COMPARED)), st.floats(0, 1e3), st.floats(0, 1e3), st.floats(0, 100))
def test_what_did_not_change_never_violates_and_who_allows_more_forbids_less(metric, before, now, allowed):
    down = COMPARED[metric].better == "more"
    for unit in ("", "%"):
        strict, loose = parse_thresholds(
            f"{metric}:{'-' if down else '+'}{allowed:.3f}{unit} {metric}:{'-' if down else '+'}{2 * allowed:.3f}{unit}"
        )
        assert not strict.violated({metric: before}, {metric: before})
        if not strict.violated({metric: before}, {metric: now}):
            assert not loose.violated({metric: before}, {metric: now})


@pytest.mark.parametrize(
    "word", ["min_ttc_s", "min_ttc_s:5%", "min_ttc_s:-", "min_ttc_s:-5%%", ":-5", "score:-1e3", "ttc:-1"]
)
def test_expressions_that_are_none(word):
    with pytest.raises(RegentsError, match="threshold"):
        parse_thresholds(word)


@pytest.mark.parametrize(
    ("expression", "said"),
    [
        ("telling,collision", "(did you mean 'telling collision'?), expected words separated by blanks"),
        ("collisions", "(did you mean 'collision'?)"),
        ("nonsense", "threshold 'nonsense', expected words"),
    ],
)
def test_a_word_that_was_meant_is_named(expression, said):
    with pytest.raises(RegentsError, match=re.escape(said)):
        parse_thresholds(expression)


def test_a_metric_that_the_baseline_lacks_is_no_silent_pass():
    (threshold,) = parse_thresholds("score:-0.1")
    assert "the baseline has no score" in threshold.violated({}, {"score": 1.0})


# --- verdicts ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("before", "now", "status"),
    [
        (SAFE, SAFE, "same"),
        (SAFE, CRASH, "regression"),
        (CRASH, CRASH, "known_failure"),
        (CRASH, replace(CRASH, step=40, collision_type="head_on"), "known_failure"),
        (CRASH, SAFE, "improved"),
        (None, SAFE, "missing"),
        (replace(SAFE, hash="b" * 64), SAFE, "missing"),
        (CRASH, DriveOutcome("a" * 64, "planner_error", error="KeyError"), "regression"),
        (None, DriveOutcome("a" * 64, "planner_error", error="KeyError"), "regression"),
        (SAFE, with_metric(SAFE, min_ttc_s=1.0), "regression"),
        (CRASH, with_metric(SAFE, score=0.1), "improved"),
        (SAFE, REAR_ENDED, "same"),
        (REAR_ENDED, SAFE, "same"),
        (REAR_ENDED, CRASH, "regression"),
        (CRASH, REAR_ENDED, "improved"),
    ],
)
def test_verdicts(before, now, status):
    verdict = judge_drive("case", now, before, parse_thresholds("min_ttc_s:-5%"))
    assert verdict.status == status
    assert verdict.fails() == (status in ("regression", "missing"))
    assert verdict.fails(strict=True) == (status in ("regression", "missing", "improved"))


@pytest.mark.parametrize(
    ("before", "now", "words", "status"),
    [
        (None, SAFE, "collision", "passed"),
        (replace(SAFE, hash="b" * 64), SAFE, "telling", "passed"),
        (None, CRASH, "collision", "forbidden"),
        (None, REAR_ENDED, "collision telling", "passed"),
        (CRASH, CRASH, "collision", "forbidden"),
        (CRASH, CRASH, "telling", "known_failure"),
        (CRASH, replace(CRASH, telling=False), "telling", "known_failure"),
        (CRASH, replace(CRASH, telling=True), "collision telling", "forbidden"),
        (CRASH, replace(CRASH, telling=True, flawless=None), "flawless", "known_failure"),
        (CRASH, replace(CRASH, telling=True, flawless=True), "flawless", "forbidden"),
        (SAFE, with_metric(SAFE, red_lights=1.0), "red_lights", "forbidden"),
        (SAFE, with_metric(SAFE, min_ttc_s=1.0), "telling min_ttc_s:-5%", "regression"),
        (None, DriveOutcome("a" * 64, "planner_error", error="KeyError"), "telling", "regression"),
    ],
)
def test_events_that_are_forbidden_fail_with_and_without_a_baseline(before, now, words, status):
    verdict = judge_drive("case", now, before, parse_thresholds(words))
    assert verdict.status == status
    assert verdict.fails() == (status in ("regression", "forbidden"))
    assert bool(how_to_accept([verdict], "--update")) == (status == "passed")


def test_a_summary_for_a_pull_request():
    verdicts = [
        judge_drive("fine", SAFE, SAFE),
        judge_drive("known", CRASH, CRASH),
        judge_drive("a|b", CRASH, SAFE),
    ]
    text = markdown(verdicts, Path("suite"), "my.planner:Mine", "mirror", ["gone"])
    lines = text.splitlines()
    assert lines[0] == "### regents: my.planner:Mine in mirror: regression"
    assert lines[2] == "3 cases: 1 regressed, 1 known to fail, 1 as before"
    assert lines[6].startswith("| a\\|b | regression: collides where the baseline did not | no collision | t_bone")
    assert "fine" not in text, "what did not change needs no row"
    assert "gone" in text
    assert "regents replay 'suite/a|b' --in mirror --planner my.planner:Mine --record 'a|b.gif'" in text


@pytest.mark.parametrize(
    ("now", "options", "heading"),
    [
        (SAFE, {}, "passed"),
        (SAFE, {"strict": True}, "improvement to accept"),
        (SAFE, {"update": True}, "accepted"),
        (FAILED, {"update": True}, "regression"),
    ],
)
def test_a_summary_passes_where_the_command_does(now, options, heading):
    lines = markdown([judge_drive("case", now, CRASH)], Path("suite"), "idm", "mirror", **options).splitlines()
    assert lines[0] == f"### regents: idm in mirror: {heading}"
    assert ("See the first one:" in lines) == (heading in ("regression", "improvement to accept"))


@pytest.mark.parametrize(
    ("now", "words", "heading"),
    [(SAFE, "collision", "passed"), (CRASH, "collision", "failed"), (SAFE, "", "no baseline"), (FAILED, "", "failed")],
)
def test_a_summary_speaks_of_no_regression_where_nothing_was_accepted(now, words, heading):
    verdict = judge_drive("case", now, None, parse_thresholds(words))
    assert markdown([verdict], Path("suite"), "idm", "mirror").startswith(f"### regents: idm in mirror: {heading}\n")


def test_what_was_never_accepted_is_said_with_the_options_that_accept_it():
    passed = judge_drive("case", SAFE, None, parse_thresholds("collision"))
    assert passed.reasons == ("never accepted",)
    assert how_to_accept([passed], "--update") == "1 case without a baseline: accept what it does now with --update"


@pytest.mark.parametrize("name", ["", "a\nb"])
def test_a_name_in_the_baseline_that_is_none_is_refused(name):
    with pytest.raises(RegentsError, match=r"the name in the baseline \(--as\)"):
        drive([regression_cases.squeezes_in()], "no such planner", known_as=name, fail_on="collision")


def test_both_grades_and_a_sentence_stand_beside_a_collision():
    told, words = replace(CRASH, telling=True, flawless=False), "The adversary does not give way to the ego."
    verdict = judge_drive("case", told, CRASH, parse_thresholds("telling"), words)
    said = "(step 48), telling: yes, flawless: no"
    assert f"{said}. {words} |" in markdown([verdict], Path("suite"), "idm", "mirror")
    failure = explain(verdict, Path("suite/case"), "idm", "mirror")
    assert said in failure
    assert f"\n  in words   {words}\n" in failure
    assert "in words" not in explain(judge_drive("case", SAFE, CRASH), Path("suite/case"), "idm", "mirror")


def test_a_baseline_without_the_flawless_grade_is_read(tmp_path):
    file = tmp_path / "baseline.json"
    save_baseline(file, Baseline().accepting("idm", "mirror", {"case": replace(CRASH, telling=True)}, ["case"]))
    older = json.loads(file.read_text())
    del older["planners"]["idm"]["mirror"]["case"]["flawless"]
    file.write_text(json.dumps(older))
    assert load_baseline(file).of("idm", "mirror")["case"].flawless is None


def test_a_name_in_a_strangers_suite_is_no_mark_in_the_summary():
    name = "<img src=x> [a](http://b) a\\|b `c` \u202e"
    text = markdown([judge_drive(name, CRASH, SAFE)], Path("suite"), "idm", "mirror", [name])
    escaped = r"\<img src=x\> \[a\](http://b) a\\\|b \`c\`"
    assert f"| {escaped} \\\\u202e | regression" in text
    assert f"without a case: {escaped}" in text


def test_changes_are_said_by_metric():
    assert changes(judge_drive("case", SAFE, SAFE)) == ""
    assert changes(judge_drive("case", with_metric(SAFE, score=0.5), SAFE)) == "case: score 1 -> 0.5"
    told = replace(CRASH, telling=True, flawless=False)
    assert changes(judge_drive("case", told, CRASH)) == "case: telling not known -> yes, flawless not known -> no"
    other = replace(CRASH, collision_type="side_swipe")
    assert "(step 48) -> side_swipe collision with car02" in changes(judge_drive("case", other, CRASH))
    assert changes(judge_drive("case", CRASH, SAFE)).startswith(
        "case: no collision -> t_bone collision with car02 at 4.8 s"
    )


# --- less of an attack ------------------------------------------------------------------------


def test_a_share_of_an_attack_lies_between_the_log_and_the_attack():
    case = regression_cases.squeezes_in()
    log, attacked, half = case.log, case.tracks, weakened(case, 0.5).tracks
    assert weakened(case, 1.0) is case
    for name in ("x", "y", "yaw"):
        ends = getattr(log, name)[1:], getattr(attacked, name)[1:]
        assert getattr(half, name)[1:] == pytest.approx(0.5 * (ends[0] + ends[1]))
        assert getattr(weakened(case, 0.0).tracks, name)[1:] == pytest.approx(ends[0])
        assert np.array_equal(getattr(half, name)[0], getattr(attacked, name)[0]), "the ego's own track stays"
    assert (half.speed[1:] <= np.maximum(log.speed, attacked.speed)[1:] + 1e-9).all()


def test_headings_are_mixed_the_shorter_way():
    case = regression_cases.squeezes_in()
    turned = {name: replace(tracks, yaw=tracks.yaw + turn) for name, tracks, turn in
              (("log", case.log, math.pi - 0.1), ("tracks", case.tracks, -math.pi + 0.1))}  # fmt: skip
    half = weakened(replace(case, **turned), 0.5).tracks
    assert np.cos(half.yaw[1]) == pytest.approx(-1.0)
    assert half.speed[1] == pytest.approx(10.0 * math.cos(0.1))


# --- baselines on disk ------------------------------------------------------------------------


def test_a_baseline_is_read_as_it_was_written(tmp_path):
    baseline = Baseline().accepting("idm", "mirror", {"one": SAFE, "two": CRASH}, ["one", "two"])
    save_baseline(tmp_path / "baseline.json", baseline)
    assert load_baseline(tmp_path / "baseline.json") == baseline
    fewer = baseline.accepting("idm", "mirror", {}, ["two"]).accepting("idm", "sumo", {"one": SAFE}, ["one"])
    assert fewer.planners == {"idm": {"mirror": {"two": CRASH}, "sumo": {"one": SAFE}}}
    assert load_baseline(tmp_path / "none.json") == Baseline()


NO_STEP = '{"schema": 1, "planners": {"idm": {"mirror": {"one": {"hash": "a", "outcome": "collision"}}}}}'


@pytest.mark.parametrize("text", ["", "[]", '{"schema": 1, "planners": {"idm": 3}}', '{"planners": {', "\xff", NO_STEP])
def test_a_damaged_baseline(text, tmp_path):
    (tmp_path / "baseline.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(CaseError, match=r"baseline\.json: not a baseline, or damaged or truncated"):
        load_baseline(tmp_path / "baseline.json")


def test_where_nothing_is_accepted_a_baseline_stays(tmp_path):
    one = Baseline().accepting("idm", "mirror", {"case": SAFE}, ["case"])
    assert one.accepting("new", "mirror", {}, ["case"]).planners == one.planners
    assert one.accepting("idm", "mirror", {}, ["other"]).planners == {}
    update_baseline(tmp_path / "new.json", lambda now: now.accepting("new", "mirror", {}, ["case"]))
    assert not (tmp_path / "new.json").exists(), "an empty one would be taken for one that was accepted"


def test_two_suites_cannot_share_a_baseline_for_cases_of_one_name():
    one, two = Path("one"), Path("two")
    require_one_home({one: ["a"], two: ["a"]}, {one: one / "baseline.json", two: two / "baseline.json"})
    with pytest.raises(RegentsError, match="case a is in one and in two"):
        require_one_home({one: ["a"], two: ["b", "a"]}, {one: Path("shared"), two: Path("shared")})


def test_a_run_that_is_killed_leaves_a_baseline_that_is_whole(tmp_path):
    file = tmp_path / "baseline.json"
    code = f"""
from pathlib import Path
from regents_cosim.evaluation.regression.baseline import Baseline, DriveOutcome, save_baseline
driven = {{f"case{{i}}": DriveOutcome("a" * 64, "no_collision", metrics={{"score": 0.5}}) for i in range(300)}}
print("ready", flush=True)
while True:
    for planner in ("one", "two"):
        save_baseline(Path({str(file)!r}), Baseline().accepting(planner, "mirror", driven, driven))
"""
    for wait in (0.02, 0.05, 0.09):
        writer = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        assert writer.stdout is not None
        assert writer.stdout.readline() == "ready\n"
        while not file.exists():
            time.sleep(0.001)
        time.sleep(wait)
        writer.send_signal(signal.SIGKILL)
        writer.wait()
        writer.stdout.close()
        (entries,) = [its for found in load_baseline(file).planners.values() for its in found.values()]
        assert len(entries) == 300


# --- without pytest ---------------------------------------------------------------------------


@pytest.fixture
def suite(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return regression_cases.write(tmp_path / "suite")


def evaluate(*words):
    return run(["evaluate", *map(str, words)])


def accept_good_then(monkeypatch, planner):
    """Accept what IDM does, as if it had been `planner` then."""
    assert evaluate("suite", "--planner", "idm", "--update", "--quiet") == 0
    file = Path("suite/baseline.json")
    file.write_text(file.read_text().replace('"idm": {', f'"{planner}": {{'))


@pytest.mark.slow
def test_evaluate_fails_on_what_is_forbidden_without_a_baseline(suite, capsys):
    words = ("suite", "--planner", "idm", "--baseline", "accepted.json", "--fail-on")
    assert evaluate(*words[:3], "--fail-on", "collision") == 1
    assert "pushes: collision: expected none" in " ".join(capsys.readouterr().err.split())
    assert evaluate(*words, "off_road") == 0
    assert "3 cases without a baseline: accept" in " ".join(capsys.readouterr().err.split())
    assert not Path("accepted.json").exists()
    assert evaluate(*words[:-1], "--update") == 0
    assert evaluate(*words, "off_road") == 0
    assert "3 cases: 1 known to fail, 2 as before" in capsys.readouterr().err
    assert evaluate(*words, "collision") == 1


@pytest.mark.slow
def test_two_versions_of_a_planner_compare_by_a_name(suite, capsys):
    buggy = f"{SUPPORT / 'buggy_idm.py'}:BuggyIDM"
    assert evaluate("suite", "--planner", "idm", "--as", "mine", "--update") == 0
    assert list(load_baseline(Path("suite/baseline.json")).planners) == ["mine"]
    capsys.readouterr()
    assert evaluate("suite", "--planner", buggy, "--as", "mine", "--baseline", "suite/baseline.json") == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "squeezes_in: collides where the baseline did not" in said
    assert f"--planner {buggy}" in said, "the name is no planner"


@pytest.mark.slow
def test_evaluate_against_a_baseline(suite, capsys, monkeypatch):
    buggy = f"{SUPPORT / 'buggy_idm.py'}:BuggyIDM"
    accept_good_then(monkeypatch, buggy)
    capsys.readouterr()
    words = ("suite", "--planner", buggy, "--baseline", "suite/baseline.json")
    assert evaluate(*words, "--markdown", "summary.md", "--json") == 1
    shown = capsys.readouterr()
    rows = {row["case"]: row for row in json.loads(shown.out)}
    assert {case: row["status"] for case, row in rows.items()} == {
        "follows": "same",
        "pushes": "known_failure",
        "squeezes_in": "regression",
    }
    assert rows["squeezes_in"]["now"]["agent"] == "car02"
    assert "squeezes_in: collides where the baseline did not" in " ".join(shown.err.split())
    assert "| squeezes_in | regression: collides" in Path("summary.md").read_text()

    assert evaluate("suite/follows", "--planner", buggy, "--baseline", "suite/baseline.json", "--markdown", "-") == 0
    assert capsys.readouterr().out.startswith(f"### regents: {buggy} in mirror: passed")
    assert evaluate("suite/squeezes_in", "--planner", buggy, "--update") == 0
    assert "accepted 1 changes" in capsys.readouterr().err
    assert sorted(load_baseline(Path("suite/baseline.json")).of(buggy, "mirror")) == [
        "follows",
        "pushes",
        "squeezes_in",
    ]
    assert evaluate(*words, "--quiet") == 0


@pytest.mark.parametrize("update", [True, False])
def test_a_case_that_is_given_twice_hides_no_result(update, suite):
    case = load_case(suite / "follows")
    with pytest.raises(RegentsError, match="case 'follows' occurs 2 times"):
        drive([case, case], "log_replay", baseline="new.json" if update else None, update=update, keep=Path("kept"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--update", "--json", "--markdown", "-"), "--json and --markdown - would both print to stdout"),
        (("--update", "--markdown", "suite/suite.json/s.md"), "suite.json is not a folder that can be written to"),
        (("--baseline", "nothing.json"), "baseline not found: nothing.json (make it with --update)"),
        (("--fail-on", "score:-5%"), "add --baseline"),
        (("--fail-on", "crash"), "or one of telling, flawless, collision, off_road"),
        (("--update", "--fail-on", "score:+5%"), "say how far it may fall: score:-5%"),
        (("--background", "reactive"), "SUMO's own traffic; expected --in sumo, found --in mirror"),
        (("--update", "--in", "sumo", "--background", "reactive"), "leave out --background or --baseline"),
        (("--update", "--baseline", "suite/suite.json/new.json"), "suite.json is not a folder that can be written to"),
        (("--update", "--planner", "nosuch"), "planner 'nosuch' not found"),
    ],
)
def test_wrong_usage(suite, words, said, capsys):
    planner = () if "--planner" in words else ("--planner", "idm")
    assert evaluate("suite", *planner, *words) == 2
    error = " ".join(capsys.readouterr().err.split())
    assert said in error
    assert not Path("suite/baseline.json").exists()
