"""Tables of real commands on a terminal of 60 columns: nothing is broken within a word."""

import log_files
import pytest
from command import REGENTS
from on_a_terminal import on_a_terminal
from rich.cells import cell_len

SHORT = ("--horizon", "3", "--method", "regents", "--iterations", "1", "--no-verify", "--no-pictures", "-o", "out")
COMMANDS = {
    "attack": ["attack", "-c", "shipped:crossing", "--count", "1", *SHORT],
    "evaluate": ["evaluate", "shipped:quickstart", "--planner", "constant_velocity"],
    "inspect": ["inspect", "LOG"],
}


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_tables_and_the_notes_under_them_break_between_words(command, tmp_path):
    log = str(log_files.write_gpudrive(tmp_path))
    words = [str(REGENTS), *(log if word == "LOG" else word for word in COMMANDS[command]), "--quiet"]
    wide = set(on_a_terminal([*words, "--wide"], both=True, cwd=tmp_path)[1].split())
    _, text = on_a_terminal(words, 60, both=True, cwd=tmp_path)
    lines = [line.rstrip() for line in text.split("\n") if line.strip()]
    assert [line for line in lines if cell_len(line) > 60 and " " in line] == []
    assert [word for word in text.split() if not is_of(word, wide)] == []
    if command == "attack":
        assert "why" in text.split()
        assert {"stuck", "out_of_reach", "no_candidate", "spoilt_only"} & set(text.split())


def is_of(shown, words):
    """Whether it is one of the words, or shows one by its two ends."""
    begin, gap, end = shown.partition("…")
    return shown in words or (bool(gap) and any(word.startswith(begin) and word.endswith(end) for word in words))
