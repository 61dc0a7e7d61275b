"""Tables of real commands on terminals of 80 and of 60 columns: nothing is broken within a word."""

import sys
from pathlib import Path

import pytest
from on_a_terminal import on_a_terminal

BIN = Path(sys.executable).with_name("regents")
COMMANDS = {
    "suite list": ["suite", "list", "shipped:quickstart"],
    "suite check": ["suite", "check", "shipped:quickstart"],
    "replay": ["replay", "shipped:quickstart", "--in", "mirror"],
    "record": ["record", "-c", "shipped:crossing", "--count", "2"],
}


@pytest.mark.slow
@pytest.mark.parametrize("columns", [80, 60])
@pytest.mark.parametrize("command", COMMANDS)
def test_no_line_is_longer_than_the_terminal_and_no_word_is_broken(command, columns, tmp_path):
    output = ["-o", "out"] if command == "record" else []
    _, text = on_a_terminal([str(BIN), *COMMANDS[command], *output], columns, both=True, cwd=tmp_path)
    rows = [line for line in text.split("\n") if line[:1].isalpha() and "-0" in line.split()[0]]
    assert bool(rows) == (command != "suite check")
    assert [line for line in rows if len(line.rstrip()) > columns] == []
    _, wide = on_a_terminal([str(BIN), *COMMANDS[command], *output, "--wide"], columns, both=True, cwd=tmp_path)
    words = set(wide.split())
    for line in rows:
        for word in line.split():
            begin, gap, end = word.partition("…")
            assert word in words or (gap and any(one.startswith(begin) and one.endswith(end) for one in words)), word
    if command == "record":
        assert "next: regents attack out --planner idm -o attacked" in text
