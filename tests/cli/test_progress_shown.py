"""What a terminal shows while a command runs."""

import os
import re

import pytest
from command import REGENTS
from on_a_terminal import on_a_terminal
from shipped_cases import shipped_window

from regents_cosim.saving import save_unlisted


@pytest.mark.slow
def test_an_attack_tells_of_each_window_and_of_compiling_once(tmp_path):
    """The second run loads what the first has kept."""
    environment = os.environ | {"REGENTS_CACHE": str(tmp_path / "kept"), "XLA_FLAGS": ""}
    folder = save_unlisted(shipped_window("crossing"), tmp_path)
    settings = tmp_path / "attack.toml"
    settings.write_text("iterations = 1\njudge = false\nverify = false\npictures = false\n")
    words = [str(REGENTS), "attack", str(folder), "--method", "regents", "--config", str(settings), "--json"]
    data, cold = on_a_terminal([*words, "-o", str(tmp_path / "cold")], env=environment)
    assert data.startswith("[")
    assert "compiling once, about 30 s" in cold
    assert re.search(r"1/1\s+crossing", cold)
    _, warm = on_a_terminal([*words, "-o", str(tmp_path / "warm")], env=environment)
    assert re.search(r"1/1\s+crossing", warm)
    assert "compiling" not in warm
    _, quiet = on_a_terminal([*words, "-o", str(tmp_path / "quiet"), "--quiet"], env=environment)
    assert quiet == ""
