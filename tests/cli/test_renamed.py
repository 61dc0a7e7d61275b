"""Options that have a new name: the old one works in this release, and one line tells the new one."""

import pytest

from regents_cosim.cli.application import app, run
from regents_cosim.cli.renamed import RENAMED, with_new_names
from regents_cosim.errors import WRONG_USAGE

OLD = [(command, old, new) for command, names in RENAMED.items() for old, new in names.items()]


@pytest.mark.parametrize(("command", "old", "new"), OLD)
def test_an_old_name_is_replaced_and_the_new_one_told(command, old, new):
    told = []
    assert with_new_names([*command, "suite", old, "x", f"{old}=y"], told.append) == [
        *(*command, "suite", new, "x", f"{new}=y")
    ]
    assert told == [f"{old} is now called {new}; the old name will go in the next release"] * 2


@pytest.mark.parametrize(("command", "old", "new"), OLD)
def test_the_program_knows_the_new_name_alone(command, old, new):
    one = app
    for word in command:
        one = one[word]
    names = {name for argument in one.assemble_argument_collection() for name in argument.names}
    assert new in names
    assert old not in names


def test_what_the_option_is_called_elsewhere_is_left_alone():
    told = []
    for words in (["evaluate", "--type", "x"], ["suite", "check", "--against", "x"], []):
        assert with_new_names(words, told.append) == words
    assert told == []


def test_a_command_with_the_old_name_runs(capsys, tmp_path):
    words = ["evaluate", "shipped:quickstart", "--planner", "log_replay", "--against", str(tmp_path / "none.json")]
    assert run(words) == WRONG_USAGE
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("regents: note: --against is now called --baseline")
    assert "baseline not found" in said[1]


@pytest.mark.parametrize("words", [["--axes", "tag, kind,ego"], ["--axes=tag, kind,ego"]])
def test_axes_have_new_names_too(words):
    told = []
    renamed = with_new_names(["suite", "coverage", "tag", *words], told.append)
    assert "=".join(renamed[3:]) == "--axes=manoeuvre,collision_type,ego"
    assert renamed[2] == "tag"
    assert [line.split(";")[0] for line in told] == [
        "tag is now called manoeuvre", "kind is now called collision_type",
    ]  # fmt: skip
