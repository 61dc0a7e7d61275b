"""A name misspelt: the nearest that is known, never one that does not exist."""

import pytest

from regents_cosim.checks.names import did_you_mean
from regents_cosim.cli import run

NETWORKS = ("merge", "crossing", "signals")


def test_the_nearest_or_all():
    assert did_you_mean("Mergee", NETWORKS) == "did you mean merge?"
    assert (
        did_you_mean("xyz", NETWORKS, "shipped:") == "expected one of shipped:merge, shipped:crossing, shipped:signals"
    )


SAID = {
    ("attack", "shipped:merge", "-o", "a"): "is traffic, expected cases: name it with -c",
    ("attack", "mergee", "-o", "a"): "did you mean -c shipped:merge?",
    ("replay", "standrad"): "did you mean shipped:standard?",
    ("attack", "-c", "shipped:mergee", "-o", "a"): "did you mean shipped:merge?",
    ("attack", "-c", "shipped:merge", "--planner", "imd", "-o", "a"): "did you mean idm?",
    ("attack", "-c", "shipped:merge", "--planner", "p.py:Mien", "-o", "a"): "p.py has no 'Mien' (did you mean Mine?)",
    ("attack", "-c", "shipped:merge", "--planner", "p.py", "-o", "a"): "name the planner in it as well, p.py:CLASS",
    ("attack", "-c", "shipped:merge", "--planer", "idm", "-o", "a"): "Did you mean --planner?",
    ("attack",): "nothing to attack: expected a case or a folder of cases",
    ("attack", "shipped:standard", "-c", "shipped:merge", "-o", "a"): "and traffic are named: expected one of them",
    ("attack", "-c", "shipped:merge", "--count", "-3", "-o", "a"): "--count is -3, expected",
    ("record", "-c", "shipped:merge", "--horizon", "0.5", "-o", "a"): "`horizon` is 0.5, expected 1 to 3600",
    ("evaluate", "x", "--planner", "idm", "--act-timeout", "nan"): "expected a number of 0 or more",
    ("atack",): "(see `regents --help`)",
    ("suite", "bild"): "(see `regents suite --help`)",
}


@pytest.mark.parametrize("words", SAID, ids=" ".join)
def test_each_mistake_is_one_line_and_leaves_nothing(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.py").write_text("class Mine:\n    pass\n")
    assert run(list(words)) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert SAID[words] in said
    assert {path.name for path in tmp_path.iterdir()} <= {"p.py", "__pycache__"}
