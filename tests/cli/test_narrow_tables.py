"""Tables of real commands on terminals of 80 and of 60 columns: nothing is broken within a word."""

import log_files
import pytest
from command import REGENTS
from on_a_terminal import on_a_terminal
from rich.cells import cell_len

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
    _, text = on_a_terminal([str(REGENTS), *COMMANDS[command], *output], columns, both=True, cwd=tmp_path)
    rows = [line for line in text.split("\n") if line[:1].isalpha() and "-0" in line.split()[0]]
    assert bool(rows) == (command != "suite check")
    # a word that is longer than the terminal is not broken: it stands on a line of its own
    assert [line for line in rows if len(line.rstrip()) > columns and len(line.split()) > 1] == []
    _, wide = on_a_terminal([str(REGENTS), *COMMANDS[command], *output, "--wide"], columns, both=True, cwd=tmp_path)
    words = set(wide.split())
    assert [word for line in rows for word in line.split() if not is_of(word, words)] == []
    if command == "record":
        assert "next: regents attack out --planner idm -o attacked" in text


SHORT = ("--horizon", "3", "--method", "regents", "--iterations", "1", "--no-verify", "--no-pictures", "-o", "out")
QUIET = {
    "attack": ["attack", "-c", "shipped:crossing", "--count", "1", *SHORT],
    "evaluate": ["evaluate", "shipped:quickstart", "--planner", "constant_velocity"],
    "inspect": ["inspect", "LOG"],
}


@pytest.mark.slow
@pytest.mark.parametrize("command", QUIET)
def test_tables_and_the_notes_under_them_break_between_words(command, tmp_path):
    log = str(log_files.write_gpudrive(tmp_path))
    words = [str(REGENTS), *(log if word == "LOG" else word for word in QUIET[command]), "--quiet"]
    wide = set(on_a_terminal([*words, "--wide"], both=True, cwd=tmp_path)[1].split())
    for columns in (80, 60):
        _, text = on_a_terminal(words, columns, both=True, cwd=tmp_path)
        lines = [line.rstrip() for line in text.split("\n") if line.strip()]
        assert [line for line in lines if cell_len(line) > columns and " " in line] == []
        assert [word for word in text.split() if not is_of(word, wide)] == []
        if command == "attack":
            assert "why" in text.split()
            assert {"stuck", "out_of_reach", "no_candidate", "spoilt_only"} & set(text.split())


def is_of(shown, words):
    """Whether it is one of the words, or shows one by its two ends."""
    begin, gap, end = shown.partition("…")
    return shown in words or (bool(gap) and any(word.startswith(begin) and word.endswith(end) for word in words))
