"""The pytest plugin as people use it: sessions of pytest inside a session of pytest."""

import json
import os
import shutil
import subprocess
import sys
import time
from importlib.metadata import entry_points
from xml.etree import ElementTree

import pytest
import regression_cases
from params import slow
from places import SUPPORT
from shipped_cases import crash_on

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import load_manifest, save_suite
from regents_cosim.evaluation.regression import comparison as regression
from regents_cosim.evaluation.regression import drives_ahead
from regents_cosim.evaluation.regression.baseline import load_baseline
from regents_cosim.evaluation.suites import cards
from regents_cosim.planners import blind, idm
from regents_cosim.saving import SuiteWriter

pytest_plugins = ["pytester"]

# An inner session forgets the modules that it is the first to import, and a second copy of them is of other classes.
IMPORTED_ALREADY = (cards, drives_ahead, regression, blind, idm)

INSTALLED = "regents" in entry_points(group="pytest11").names
PLUGIN = () if INSTALLED else ("-p", "regents_cosim.pytest_plugin")
GOOD = "from regents_cosim.planners.idm import IDM as Mine\n"
BUGGY = f"import sys\nsys.path.insert(0, {str(SUPPORT)!r})\nfrom buggy_idm import BuggyIDM as Mine\n"
CASES = ["follows", "pushes", "squeezes_in"]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The suite, written before an inner session could forget modules."""
    return regression_cases.write(tmp_path_factory.mktemp("written") / "suite")


@pytest.fixture
def project(written, pytester):
    """A folder with a suite and a planner, as somebody's repository."""
    shutil.copytree(written, pytester.path / "suite")
    pytester.makeini("[pytest]\naddopts = --strict-markers --strict-config -p no:jaxtyping\n")
    (pytester.path / "planner.py").write_text(GOOD)
    return pytester


def session(project, *words, isolated=False, planner="planner.py:Mine"):
    run = project.runpytest_subprocess if isolated else project.runpytest_inprocess
    return run(*PLUGIN, "--regents-suite", "suite", *(("--regents-planner", planner) if planner else ()), *words)


def baseline_of(project):
    return load_baseline(project.path / "suite" / "baseline.json")


def said(done):
    return " ".join((done.stdout.str() + done.stderr.str()).split())


def properties(report):
    """What JUnit is told of each case."""
    cases = ElementTree.parse(report).getroot().iter("testcase")
    return {case.get("name"): {one.get("name"): one.get("value") for one in case.iter("property")} for case in cases}


# --- the life of a baseline -------------------------------------------------------------------


def test_a_bug_is_caught_and_the_case_is_named(project):
    done = session(project)
    done.assert_outcomes(failed=3)
    assert "no baseline: never accepted" in done.stdout.str(), "what was never accepted fails"
    assert not (project.path / "suite" / "baseline.json").exists()

    done = session(project, "--regents-update")
    done.assert_outcomes(passed=3)
    done.stdout.fnmatch_lines(["accepted 3 changes", "*pushes: new: side_swipe collision with car02 at * s*"])

    done = session(project)
    done.assert_outcomes(passed=3)
    done.stdout.fnmatch_lines(["3 cases: 1 known to fail, 2 as before", "known to fail: pushes"])

    (project.path / "planner.py").write_text(BUGGY)
    done = session(project)
    done.assert_outcomes(passed=2, failed=1)
    assert done.ret == 1
    done.stdout.fnmatch_lines(
        [
            "regression: collides where the baseline did not",
            "  case       squeezes_in",
            "  planner    planner.py:Mine in mirror",
            "  adversary  car02 (side_swipe, found by hand against idm)",
            "  baseline   no collision; *score *",
            "  now        side_swipe collision with car02 at * s (step *), telling: *, flawless: *; *",
            "  in words   * A careful driver *.",
            "  see it     regents replay suite/squeezes_in --in mirror --planner planner.py:Mine --record *.gif",
            "FAILED suite/suite.json::squeezes_in*",
        ]
    )

    (project.path / "planner.py").write_text(GOOD)
    session(project).assert_outcomes(passed=3)


def test_a_suite_in_a_virtual_environment_is_found(project):
    """Where the shipped ones lie, when that is in the folder of the project."""
    place = project.mkdir(".venv")
    (place / "pyvenv.cfg").touch()
    suite = (project.path / "suite").rename(place / "suite")
    (project.path / "test_mine.py").write_text("def test_mine(): pass")
    words = (*PLUGIN, "--regents-suite", suite, "--regents-planner", "idm", "--collect-only")
    for named, count in (((), 3), (("test_mine.py",), 4), ((f"{suite}/suite.json::pushes",), 1)):
        project.runpytest_inprocess(*words, *named).stdout.fnmatch_lines([f"*{count} test* collected*"])


@pytest.mark.slow
def test_an_update_says_what_changed_and_forgets_what_left(project):
    (project.path / "planner.py").write_text(BUGGY)
    session(project, "--regents-update")
    (project.path / "planner.py").write_text(GOOD)
    done = session(project)
    done.assert_outcomes(passed=3)
    done.stdout.fnmatch_lines(["improved (accept with --regents-update): squeezes_in"])
    session(project, "--regents-strict").assert_outcomes(passed=2, failed=1)

    suite = load_manifest(project.path / "suite")
    fewer = tuple(entry for entry in suite.cases if entry.case != "follows")
    save_suite(project.path / "suite", type(suite)(fewer))
    session(project).stdout.fnmatch_lines(["unused baseline entry: follows in *baseline.json"])
    done = session(project, "--regents-update")
    done.stdout.fnmatch_lines(
        ["removed baseline entry: follows in *", "  squeezes_in: side_swipe collision with car02*"]
    )
    entries = baseline_of(project).of("planner.py:Mine", "mirror")
    assert sorted(entries) == ["pushes", "squeezes_in"]
    assert entries["squeezes_in"].outcome == "no_collision"


@pytest.mark.slow
def test_a_case_that_changed_has_no_baseline_any_more(project):
    session(project, "--regents-update")
    folder = project.path / "suite"
    text = (folder / "baseline.json").read_text()
    digest = next(entry.hash for entry in load_manifest(folder).cases if entry.case == "follows")
    (folder / "baseline.json").write_text(text.replace(digest, "0" * 64))
    done = session(project)
    done.assert_outcomes(passed=2, failed=1)
    assert "no baseline: the case has changed since its baseline was accepted" in done.stdout.str()


@pytest.mark.slow
def test_one_baseline_for_several_planners_somewhere_else(project):
    words = ("--regents-baseline", "accepted.json")
    for planner in ("planner.py:Mine", "constant_velocity"):
        session(project, *words, "--regents-update", planner=planner).assert_outcomes(passed=3)
    assert set(load_baseline(project.path / "accepted.json").planners) == {"planner.py:Mine", "constant_velocity"}
    session(project, *words).assert_outcomes(passed=3)


# --- thresholds -------------------------------------------------------------------------------


@pytest.mark.slow
def test_metrics_that_get_worse_fail_where_that_is_asked_for(project):
    session(project, "--regents-update")
    file = project.path / "suite" / "baseline.json"
    baseline = json.loads(file.read_text())
    follows = baseline["planners"]["planner.py:Mine"]["mirror"]["follows"]
    follows["metrics"]["score"] *= 1.1
    file.write_text(json.dumps(baseline))
    session(project).assert_outcomes(passed=3)
    session(project, "--regents-fail-on", "score:-10% collision:+0").assert_outcomes(passed=3)
    done = session(project, "--regents-fail-on", "score:-5% collision:+0")
    done.assert_outcomes(passed=2, failed=1)
    done.stdout.fnmatch_lines(["regression: score:-5%: score fell from * to *, allowed to *", "  case       follows"])


@pytest.mark.slow
def test_a_first_run_without_a_baseline_passes_or_fails_by_what_is_forbidden(project):
    done = session(project, "--regents-fail-on", "telling collision")
    done.assert_outcomes(passed=2, failed=1)
    done.stdout.fnmatch_lines(
        ["forbidden: collision: expected none", "  case       pushes", "2 cases without a baseline: accept *"]
    )
    assert not (project.path / "suite" / "baseline.json").exists()


@pytest.mark.slow
def test_two_files_are_versions_of_one_planner(project):
    named = ("--regents-as", "mine")
    session(project, *named, "--regents-update").assert_outcomes(passed=3)
    assert set(baseline_of(project).planners) == {"mine"}
    (project.path / "newer.py").write_text(BUGGY)
    done = session(project, *named, planner="newer.py:Mine")
    done.assert_outcomes(passed=2, failed=1)
    done.stdout.fnmatch_lines(["  planner    newer.py:Mine in mirror", "*--planner newer.py:Mine*"])


# --- planners that fail -----------------------------------------------------------------------


@pytest.mark.slow
def test_a_planner_that_raises_or_hangs_costs_its_own_case_only(project):
    planner = f"{SUPPORT / 'regression_planners.py'}:Moody"
    done = session(project, "--regents-update", "--regents-act-timeout", "1", "--junit-xml", "j.xml", planner=planner)
    done.assert_outcomes(passed=1, failed=2)
    assert "regression: failed: planner" in done.stdout.str()
    assert "KeyError: 'lost'" in done.stdout.str()
    assert "gave no answer within 1 s in `act` at step 3" in done.stdout.str()
    for text in (done.stdout.str(), (project.path / "j.xml").read_text()):  # the planner's own lines, none of ours
        assert "regression_planners.py&quot;, line" in text or 'regression_planners.py", line' in text
        assert 'raise KeyError("lost")' in text
        assert "in act" in text
        assert "host_server.py" not in text.partition("KeyError")[2].partition("in act")[0]
    failed = [case for case in properties(project.path / "j.xml").values() if case["outcome"] == "planner_error"]
    assert [(case["gate"], "regression_planners.py" in case["failure"]) for case in failed] == 2 * [("failed", True)]
    assert list(baseline_of(project).of(planner, "mirror")) == ["follows"], "a failure is never accepted"


# --- choosing, and other plugins --------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "chosen"),
    [
        (("-k", "squeezes"), ["squeezes_in"]),
        (("-k", "side_swipe"), ["pushes", "squeezes_in"]),
        (("-m", "regents(collision_type='ordinary')"), ["follows"]),
        (("-m", "regents(planner='idm') and not regents(collision_type='t_bone')"), ["pushes", "squeezes_in"]),
        (("-m", "not regents"), []),
        (("suite/suite.json::follows",), ["follows"]),
    ],
)
def test_choosing(project, words, chosen):
    done = session(project, "--collect-only", "-q", *words)
    found = [line.partition("::")[2] for line in done.outlines if line.startswith("suite/suite.json::")]
    assert found == chosen


@pytest.mark.parametrize("way", ["--collect-only", "--setup-plan", "--setup-only"])
def test_where_no_test_runs_nothing_is_driven_or_accepted(project, way):
    (project.path / "planner.py").write_text("raise ZeroDivisionError\n")
    done = session(project, way, "--regents-update")
    assert "ZeroDivisionError" not in said(done)
    assert done.ret == 0
    assert not (project.path / "suite" / "baseline.json").exists()


@pytest.mark.slow
def test_last_failed_first_failure_and_junit(project):
    session(project, "--regents-update")
    (project.path / "planner.py").write_text(BUGGY)
    session(project, "-x", "--junitxml", "out.xml").assert_outcomes(passed=2, failed=1)
    report = properties(project.path / "out.xml")
    collides = {"outcome": "collision", "collision_with": "car02", "collision_type": "side_swipe"}
    regression = {"verdict": "regression", "gate": "failed", "reasons": "collides where the baseline did not"}
    assert report["squeezes_in"].items() >= (collides | regression).items()
    known = {"verdict": "known_failure", "gate": "passed", "case_collision_type": "side_swipe", "case_planner": "idm"}
    assert report["pushes"].items() >= (collides | known).items()
    hit = regression_cases.pushes().collision
    assert (int(report["pushes"]["collision_step"]), report["pushes"]["case_adversary"]) == (hit.step, hit.agent)
    assert (
        report["follows"].items()
        >= {"outcome": "no_collision", "gate": "passed", "case_collision_type": "ordinary"}.items()
    )
    assert not {"collision_with", "collision_step", "reasons", "case_adversary"} & set(report["follows"])
    done = session(project, "--lf")
    done.assert_outcomes(failed=1)
    assert "squeezes_in" in done.stdout.str()


@pytest.mark.slow
def test_workers_of_xdist_hand_over_what_they_saw(project):
    done = session(project, "--regents-update", "-n", "2", isolated=True)
    done.assert_outcomes(passed=3)
    assert "accepted 3 changes" in done.stdout.str()
    assert sorted(baseline_of(project).of("planner.py:Mine", "mirror")) == CASES


@pytest.mark.slow
def test_tests_written_by_hand(project):
    project.makepyfile(
        """
        import pytest
        from pathlib import Path

        def test_it_keeps_out_of_trouble(regents):
            assert [case.name for case in regents.suite] == ["follows", "pushes", "squeezes_in"]
            drive = regents.drive("suite/follows")
            assert drive.hits is None and drive.completion > 0.8

        def test_another_one(regents):
            assert regents.drive(Path("suite/pushes"), planner="constant_velocity").hits == "car02"
        """
    )
    session(project, "-m", "not regents", ".").assert_outcomes(passed=2, deselected=3)
    session(project, "--regents-update", ".").assert_outcomes(passed=5)


@pytest.mark.slow
def test_ini_keys_do_as_the_options(project):
    project.makeini(
        "[pytest]\naddopts = --strict-config -p no:jaxtyping\n"
        "regents_suite = suite\nregents_planner = planner.py:Mine\n"
        "regents_baseline = accepted.json\nregents_fail_on = score:-5%\nregents_in = mirror\n"
    )
    project.runpytest_inprocess(*PLUGIN, "--regents-update").assert_outcomes(passed=3)
    assert (project.path / "accepted.json").is_file()
    for elsewhere, tests in ((project.mkdir("sub"), ()), (project.path.parent, (project.path,))):
        os.chdir(elsewhere)  # pytester goes back
        project.runpytest_subprocess(*PLUGIN, *tests).assert_outcomes(passed=3)


@pytest.mark.parametrize(
    ("keys", "words", "what"),
    [
        ("regents_suite = shipped:quickstart", (), "12 tests collected"),
        ("regents_suite = shipped:quick", (), "shipped:quick does not exist, did you mean"),
        ("regents_suite = suite\nregents_baseline = my accepted.json", (), "accepted.json, expected one file"),
        ("testpaths = tests", ("--regents-update",), "--regents-update needs the cases whose outcomes it accepts"),
    ],
)
def test_ini_keys_are_read_as_the_options(project, keys, words, what):
    project.makeini(f"[pytest]\naddopts = -p no:jaxtyping\nregents_planner = idm\n{keys}\n")
    done = project.runpytest_inprocess(*PLUGIN, "--collect-only", *words)
    assert what in said(done)
    assert "Traceback" not in said(done)


@pytest.mark.slow
def test_in_sumo(project):
    """A case of the shipped suite, whose network SUMO has; the planner runs in a process of its own."""
    case = load_case(crash_on("merge"))
    SuiteWriter(project.path / "suite", 0).add(case)
    done = session(project, "--regents-in", "sumo", "--regents-update", "-k", "merge", planner="idm")
    done.assert_outcomes(passed=1, deselected=3)
    hit = case.collision
    assert f"{hit.collision_type} collision with {hit.agent} at {hit.time_s:.1f} s" in done.stdout.str()


@pytest.mark.slow
def test_a_session_that_is_killed_leaves_suite_and_baseline_whole(project):
    words = ["--regents-suite", "suite", "--regents-planner", "constant_velocity", "--regents-update"]
    command = [sys.executable, "-m", "pytest", *PLUGIN, *words]
    began = time.monotonic()
    assert subprocess.run(command, cwd=project.path, capture_output=True).returncode == 0
    whole_s, before = time.monotonic() - began, (project.path / "suite" / "baseline.json").read_bytes()
    for part in (0.8, 1.0):
        (project.path / "suite" / "baseline.json").unlink(missing_ok=True)
        with subprocess.Popen(command, cwd=project.path, stdout=subprocess.DEVNULL) as running:
            time.sleep(part * whole_s)
            running.kill()
        if (project.path / "suite" / "baseline.json").exists():
            assert (project.path / "suite" / "baseline.json").read_bytes() == before
        assert sorted(load_case(project.path / "suite" / name).id for name in CASES) == CASES
    session(project, "--regents-update", planner="constant_velocity").assert_outcomes(passed=3)
    assert (project.path / "suite" / "baseline.json").read_bytes() == before


# --- wrong usage ------------------------------------------------------------------------------


def _truncate(folder):
    (folder / "suite" / "baseline.json").write_text('{"planners": {"idm": {"mir')


def _other_schema(folder):
    (folder / "suite" / "baseline.json").write_text('{"schema": 99}')


def _damage(folder):
    (folder / "suite" / "suite.json").write_text("{")


@pytest.mark.parametrize(
    ("spoil", "planner", "words", "what"),
    [
        (None, None, (), "needs the planner that is tested: --regents-planner NAME"),
        (None, "nosuch", (), "planner 'nosuch' not found, expected one of"),
        (None, "planner.py:Nothing", (), "planner.py has no 'Nothing'"),
        (None, "idm", ("--regents-suite", "elsewhere"), "no suite.json in"),
        (None, "idm", ("--regents-suite", "shipped:quick"), "shipped:quick does not exist, did you mean"),
        (None, "idm", ("--regents-update", "--regents-baseline", "planner.py/new.json"), "planner.py is not a folder"),
        (None, "idm", ("--regents-fail-on", "min_ttc:-5%"), "unknown metric 'min_ttc', expected one of collision"),
        (
            None,
            "idm",
            ("--regents-fail-on", "score:+5%"),
            "of score more is better, so say how far it may fall: score:-5%",
        ),
        (None, "idm", ("--regents-fail-on", "score -5"), "threshold 'score', expected words separated by blanks"),
        (_truncate, "idm", (), "baseline.json: not a baseline, or damaged or truncated"),
        (_other_schema, "idm", (), "baseline.json: schema 99, this version reads 1"),
        (_damage, "idm", (), "suite.json: damaged or truncated"),
    ],
)
def test_wrong_usage_is_said_once(project, spoil, planner, words, what):
    if spoil is not None:
        spoil(project.path)
    done = session(project, *words, planner=planner)
    assert done.ret == pytest.ExitCode.USAGE_ERROR
    assert what in said(done)
    assert said(done).count(what) == 1
    assert "Traceback" not in said(done)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("environment", "planner", "what"),
    [({}, "nosuch", "planner 'nosuch' not found"), ({"JAX_PLATFORMS": "nosuch"}, "idm", "JAX has no device with")],
)
def test_workers_of_xdist_say_wrong_usage_once(project, monkeypatch, environment, planner, what):
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    done = session(project, "-n", "2", planner=planner, isolated=True)
    assert done.ret == pytest.ExitCode.USAGE_ERROR
    assert said(done).count(what) == 1
    assert "Traceback" not in said(done)
    assert "INTERNALERROR" not in said(done)


@pytest.mark.slow
def test_a_damaged_case_fails_alone(project):
    session(project, "--regents-update")
    (project.path / "suite" / "pushes" / "tracks.npz").write_bytes(b"PK")
    done = session(project)
    done.assert_outcomes(passed=2, failed=1)
    assert "tracks.npz: damaged or truncated" in done.stdout.str()


# --- what an archive brings beside a suite ----------------------------------------------------

RUN = "open('PWNED', 'a').write(__file__)\n"
BESIDE = {
    "conftest.py": RUN,
    "__init__.py": RUN,
    "test_it.py": RUN,
    "more/conftest.py": RUN,
    "pytest.ini": "[pytest]\naddopts = --no-such-option\n",
    "pyproject.toml": "[tool.pytest.ini_options]\naddopts = '--no-such-option'\n",
}


@pytest.fixture
def archive(written, pytester):
    """A folder of a stranger, with a suite in it, where it was unpacked; the user has tests of his own."""
    shutil.copytree(written, pytester.path / "test-archive" / "inner" / "suite")
    for name in ("mine/conftest.py", "conftest.py"):
        (pytester.path / name).parent.mkdir(exist_ok=True)
        (pytester.path / name).write_text("def pytest_report_header(config): return 'my own: ' + __file__\n")
    (pytester.path / "mine" / "test_mine.py").write_text("def test_mine(): pass\n")
    (pytester.path / "elsewhere").mkdir()
    yield pytester
    assert not list(pytester.path.rglob("PWNED")), [path.read_text() for path in pytester.path.rglob("PWNED")]


SUITE = "test-archive/inner/suite"
WAYS = {
    "alone": (".", f"--regents-suite={SUITE}"),
    "with a space": (".", "--regents-suite", SUITE),
    "with tests": (".", "mine", f"--regents-suite={SUITE}"),
    "from elsewhere": ("elsewhere", f"--regents-suite=../{SUITE}"),
    "a case": (".", f"--regents-suite={SUITE}", f"{SUITE}/suite.json::follows"),
    "the suite": (".", f"--regents-suite={SUITE}", SUITE),
    "by a link": (".", "--regents-suite=test-archive/inner/link"),
}


@pytest.mark.parametrize("way", [name if name in ("alone", "a case") else slow(name) for name in WAYS])
@pytest.mark.parametrize("name", BESIDE)
def test_nothing_beside_a_suite_is_run(archive, monkeypatch, name, way):
    here, *words = WAYS[way]
    (archive.path / "test-archive" / "inner" / "link").symlink_to("suite")
    for folder in ("test-archive", "test-archive/inner"):
        place = archive.path / folder / name
        place.parent.mkdir(exist_ok=True)
        place.write_text(BESIDE[name])
    monkeypatch.chdir(archive.path / here)
    done = archive.runpytest_inprocess(
        *PLUGIN, *words, "--regents-planner=idm", "--collect-only", "-q", "-p", "no:jaxtyping"
    )
    if done.ret == 0:
        assert "follows" in done.stdout.str()
        assert ("test_mine" in done.stdout.str()) == (way == "with tests")
    else:
        assert done.ret == pytest.ExitCode.USAGE_ERROR
        assert "PWNED" not in said(done)
        assert name.rpartition("/")[2] in said(done)
        assert "is not one of your files" in said(done) or "lies beside a suite" in said(done)


@pytest.mark.parametrize(
    ("words", "own"),
    [
        (["mine", "--regents-suite=mine/suite"], True),
        ([".", "--regents-suite=mine/suite"], True),
        (["--regents-suite=mine/suite"], False),
        (["mine/test_mine.py", "--regents-suite=mine/suite"], True),
        (["-o", "testpaths=mine", "--regents-suite=mine/suite"], False),
        (["-o", "regents_suite=mine/suite"], True),
        (["mine/suite/suite.json", "-o", "regents_suite=mine/suite"], True),
    ],
)
def test_the_own_conftest_of_tests_holds_for_a_suite_beside_them(archive, written, words, own):
    shutil.copytree(written, archive.path / "mine" / "suite")
    (archive.path / "conftest.py").write_text(
        "def pytest_runtest_setup(item): item.add_report_section('x', 'root', '')\n"
    )
    hook = "def pytest_runtest_call(item):\n    print('call of', item.nodeid)\n"
    (archive.path / "mine" / "conftest.py").write_text(hook)
    done = archive.runpytest_inprocess(
        *PLUGIN,
        *words,
        "--regents-planner=constant_velocity",
        "--regents-update",
        "-p",
        "no:jaxtyping",
        "-s",
        "-k",
        "follows or mine",
    )
    assert done.ret == 0, said(done)
    assert ("call of mine/suite/suite.json::follows" in done.stdout.str()) == own


@pytest.mark.parametrize("ini", ["testpaths = tests", ""])
def test_suites_that_are_named_run_alone(project, ini):
    project.makeini(f"[pytest]\naddopts = -p no:jaxtyping\n{ini}\n")
    for name in ("tests/conftest.py", "tests/test_mine.py", "test_here.py"):
        (project.path / name).parent.mkdir(exist_ok=True)
        (project.path / name).write_text("raise ImportError('of a package for developers')\n")
    (project.path / "conftest.py").write_text("def pytest_report_header(config): return 'my own header'\n")
    done = session(project, "--collect-only", planner="idm")
    assert (done.ret, "3 tests collected" in done.stdout.str()) == (0, True), said(done)
    assert "my own header" in done.stdout.str()
    assert "of a package for developers" in said(session(project, "--collect-only", ".", planner="idm"))


def test_a_suite_holds_no_tests(archive):
    (archive.path / SUITE / "follows" / "test_it.py").write_text(RUN)
    (archive.path / SUITE / "follows" / "conftest.py").write_text(RUN)
    (archive.path / SUITE / "test_it.py").write_text(RUN)
    done = archive.runpytest_inprocess(
        *PLUGIN, f"--regents-suite={SUITE}", "--regents-planner=idm", "--collect-only", "-q", "-p", "no:jaxtyping"
    )
    assert done.ret == 0
    assert "3 tests collected" in done.stdout.str()


def test_a_case_that_is_not_there(project):
    done = session(project, "suite/suite.json::nothing")
    assert done.ret == pytest.ExitCode.USAGE_ERROR
    assert "not found: suite/suite.json::nothing" in said(done)


# --- who does not use it ----------------------------------------------------------------------


def test_a_project_without_suites_does_not_notice(pytester):
    pytester.makeini("[pytest]\naddopts = --strict-markers --strict-config -p no:jaxtyping\n")
    pytester.makepyfile(
        """
        import sys

        def test_nothing_heavy_is_loaded():
            assert not {"jax", "numpy", "shapely", "msgspec", "equinox"} & set(sys.modules)
        """
    )
    (pytester.path / "suite.json").write_text("{}")
    pytester.runpytest_subprocess(*PLUGIN, "-p", "no:jaxtyping").assert_outcomes(passed=1)
    shown = pytester.runpytest_inprocess(*PLUGIN, "--markers").stdout.str()
    assert "@pytest.mark.regents(suite, collision_type, network, planner, TAG)" in shown


@pytest.mark.slow
def test_the_package_is_imported_as_it_is(project, monkeypatch):
    """Python's `ast` fails by chance in threads (python/cpython#106905), so pytest may not rewrite what they import."""
    wheel = project.mkdir("site") / "installed-1.dist-info"  # lists the package, as that of a wheel does
    wheel.mkdir()
    (wheel / "METADATA").write_text("Metadata-Version: 2.1\nName: installed\nVersion: 1\n")
    (wheel / "RECORD").write_text("regents_cosim/__init__.py,,\n")
    (wheel / "entry_points.txt").write_text("[pytest11]\nregents = regents_cosim.pytest_plugin\n")
    monkeypatch.setenv("PYTHONPATH", str(wheel.parent), prepend=os.pathsep)
    project.makeconftest(
        "import sys\n\n"
        "def pytest_sessionfinish():\n"
        "    names = ('planners.idm', 'replays.mirror', 'verdicts.judge')\n"
        "    loaders = {type(sys.modules[f'regents_cosim.{name}'].__loader__).__name__ for name in names}\n"
        "    print('loaded by', *loaders)\n"
    )
    done = session(project, "-s", "--regents-update", isolated=True)
    done.assert_outcomes(passed=3)
    assert "loaded by SourceFileLoader" in done.stdout.str()


def test_listing_the_cases_loads_no_jax(project):
    code = f"""
import sys, pytest
code = pytest.main({[*PLUGIN, "--regents-suite", "suite", "--regents-planner", "idm", "--collect-only", "-q"]!r})
print("loaded:", {{"jax", "equinox"}} & set(sys.modules))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=project.path)
    assert "loaded: set()" in done.stdout
    assert "3 tests collected" in done.stdout
