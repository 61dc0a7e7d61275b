"""What a person sees is what the text says, whatever it holds."""

import subprocess
import sys

import pytest
from command import REGENTS, regents
from on_a_terminal import on_a_terminal

from regents_cosim.cli import run
from regents_cosim.cli.terminal import Terminal

HOSTILE = [
    "weird [/x]",
    "pl.py:Bug",
    ":beetle:",
    "[red]fleet.py:Car",
    "\x1b[2Jgone",
    "bell\x07",
    "[link=x]a[/link]",
    "\ud800",
]
SHOWN = {"\x1b[2Jgone": r"\x1b[2Jgone", "bell\x07": r"bell\x07", "\ud800": r"\ud800"}


@pytest.mark.parametrize("text", HOSTILE)
def test_no_text_is_markup_an_emoji_or_a_command(text, capsys, caplog):
    caplog.set_level("INFO")  # a log that cannot be encoded ended the tests of a whole worker
    terminal = Terminal()
    terminal.show(text, [{text: text, "list": [text, text]}], text)
    terminal.say(text)
    terminal.publish(text, None)
    list(terminal.each([1], text, 1))
    with terminal.waiting(text):
        pass
    said = capsys.readouterr()
    shown = SHOWN.get(text, text)
    assert said.out.count(shown) == 7
    assert caplog.messages[0] == shown
    "".join(caplog.messages).encode()
    assert said.err == f"{shown}\n"
    assert "\x1b" not in said.out


@pytest.mark.parametrize("text", HOSTILE)
def test_what_stands_beside_a_bar_is_plain_as_well(text, capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "200")
    with Terminal().waiting(text):
        pass
    assert SHOWN.get(text, text) in capsys.readouterr().err


def test_an_error_is_one_line_of_500_characters_without_control_characters(capsys):
    assert run(["record", "-c", "\x1b[31m\n" + 1500 * "d/", "-o", "out"]) == 2
    said = capsys.readouterr().err
    assert said.endswith("\n")
    assert len(said) == 501
    assert said[:-1].isprintable()


@pytest.mark.parametrize(
    "words", [["evaluate", "no/such/" + 40 * "d/" + "suite"], ["record", "--cuont", "3"], ["atack"]]
)
def test_an_error_breaks_between_words_on_a_terminal_alone(words):
    _, shown = on_a_terminal([str(REGENTS), *words], 60, code=2)
    piped = regents(*words).stderr
    assert shown.split() == piped.split()
    assert piped.count("\n") == 1
    assert all(len(line) <= 60 or " " not in line for line in shown.splitlines())
    assert piped.startswith("regents: ")


NAME = "roundabout-00162.0s-south_in.north_out.12-focused-log_replay-south_in.north_out.10"
TABLE = """
import sys
from regents_cosim.cli.terminal import Terminal
row = {"case": sys.argv[1], "outcome": "collision", "expected": "main.exit.193 at step 54", "iterations": 17,
       "position_error_mm": 1e-12, "yaw_error_deg": 0.3, "SUMO_verified": True, "own_list_has_it": None}
table = Terminal(wide="wide" in sys.argv)
table.show("a title of many words " * 9, [row, row], "a note of many words " * 9, ("case", "outcome", "SUMO_verified"))
if "say" in sys.argv:
    table.say("a line of many words " * 9)
    table.suggest(("regents", "report", "my suite", "-o", "report.html"))
"""


def table_on_a_terminal(columns, *words):
    """The lines of a table on a terminal so wide."""
    _, said = on_a_terminal([sys.executable, "-c", TABLE, NAME, *words], columns, both=True)
    return [line.rstrip() for line in said.replace("\n\n", "\n").splitlines()]


@pytest.mark.parametrize("columns", [60, 80, 100, 140])
def test_a_table_fits_the_terminal_and_says_what_it_leaves_out(columns):
    lines = table_on_a_terminal(columns, "say")
    assert max(map(len, lines)) <= columns
    text = " ".join(lines)
    assert "next: regents report 'my suite' -o report.html" in lines
    assert all(9 * f"a {what} of many words " in f"{text} " for what in ("title", "note", "line"))
    assert "outcome" in text
    assert "verified" in text
    assert "error" in text[text.index("no room for:") : text.index("(--wide shows them)")]
    names = [line.split()[0] for line in lines if line.startswith("roundabout")]
    assert len(names) == 2  # one line each
    begin, _, end = names[0].partition("…")
    assert NAME.startswith(begin)
    assert NAME.endswith(end)
    assert len(names[0]) >= 16
    assert ("shortened: case" in text) == (names[0] != NAME)


def test_wide_and_pipes_get_every_column_on_one_line():
    assert any(NAME in line and "0.3" in line for line in table_on_a_terminal(80, "wide"))
    piped = subprocess.run([sys.executable, "-c", TABLE, NAME], capture_output=True, text=True, check=True)
    assert piped.stdout.splitlines()[1].split()[:5] == ["case", "outcome", "expected", "iterations", "position"]
    assert piped.stderr == ""
    assert len(piped.stdout.splitlines()) == 5
