"""How `--help` is laid out: in boxes that are the same in all commands, what is used most in the first."""

import re
from functools import cache, reduce

import pytest

from regents_cosim.attacks.methods.presets import METHODS
from regents_cosim.cli.application import app
from regents_cosim.cli.settings import in_help

BOXES = ["Traffic", "Planner", "Baseline", "Training", "Search", "Output", "Run", "Advanced"]
SAY_SOMETHING_ELSE = {"--ordinary", "--seed"}  # in one command than in another
IN_BOXES = ["attack", "record", "live", "train aim-bev", "suite build"]
COMMANDS = [*IN_BOXES, "evaluate", "replay", "inspect", "report", "suite rank", "suite merge", "bench table1"]


@cache
def boxes(command: str) -> dict[str, list[str]]:
    """The options of each box, in their order."""
    found: dict[str, list[str]] = {}
    one = reduce(lambda family, word: family[word], command.split(), app)
    for argument in in_help(one.assemble_argument_collection()):
        (group,) = argument.parameter.group
        found.setdefault(group.name, []).append(argument.name)
    return found


def shown(capsys, command: str) -> str:
    app([*command.split(), "--help"], exit_on_error=False, result_action="return_value")
    return capsys.readouterr().out


@pytest.mark.parametrize("command", IN_BOXES)
def test_every_option_is_in_a_box_of_what_it_is_about(command, capsys):
    titles = re.findall(r"^╭─ (.*?) ─+╮$", shown(capsys, command), re.MULTILINE)
    assert titles == [box for box in BOXES if box in titles]
    assert set(titles) == set(boxes(command))
    assert titles[-1] == ("Advanced" if command == "live" else "Run")


@pytest.mark.parametrize("command", [*COMMANDS, "suite list"])
def test_no_help_cites_a_page_that_is_not_installed(command, capsys):
    assert "docs/" not in shown(capsys, command)


def test_every_method_is_in_the_help_of_the_attack(capsys):
    words = set(re.findall(r"[\w-]+", shown(capsys, "attack")))
    missing = METHODS.keys() - words
    assert not missing, f"the help lacks {missing}"


def test_what_is_used_most_comes_first():
    found = boxes("attack")
    assert found["Traffic"][:3] == ["--cases", "--configuration-file", "--from"]
    assert {"--count", "--seed"} <= set(found["Traffic"][:6])
    assert (found["Planner"][0], found["Search"][0], found["Output"][0]) == ("--planner", "--method", "--output")


def test_an_option_that_commands_share_is_in_the_same_box():
    places: dict[str, set[str]] = {}
    for command in COMMANDS:
        assert {"--quiet", "--json", "--wide"} <= set(boxes(command)["Output"])
        for box, options in boxes(command).items():
            for option in options:
                places.setdefault(option, set()).add(box)
    assert {option for option, found in places.items() if len(found - {"Parameters"}) > 1} <= SAY_SOMETHING_ELSE


def test_sentences_run_on_where_the_lines_of_the_source_end(capsys):
    text = shown(capsys, "attack")
    inside = [line.strip("│ ") for line in text.splitlines() if line.startswith("│")]
    indents = {len(line) - len(line[1:].lstrip()) for line in text.splitlines() if re.match("│ {20,}", line)}
    assert len(indents) <= len(boxes("attack"))  # one column of words for each box
    assert "an empty cell of the map of behaviours, or are better than the best of their cell" in " ".join(
        " ".join(inside).split()
    )
