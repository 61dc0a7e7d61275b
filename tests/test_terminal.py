"""What a person sees is what the text says, whatever it holds."""

import pytest

from regents_cosim.cli import run
from regents_cosim.terminal import Terminal

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
def test_no_text_is_markup_an_emoji_or_a_command(text, capsys):
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
