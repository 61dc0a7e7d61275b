"""A picture of a replay names the planner that drove it, not the one that the case was made for."""

import pytest
from shipped_cases import crash_on

from regents_cosim.cli import run
from regents_cosim.reports import picture


@pytest.mark.slow
def test_a_picture_of_another_planner_s_replay_names_it(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(picture, "draw_still", lambda scenario, path, **_: drawn.append(scenario.attack.planner))
    case = str(crash_on("crossing"))
    for words in (["--planner", "constant_velocity"], ["--ego", "track"]):
        run(["replay", case, "--in", "mirror", *words, "--record", str(tmp_path / "seen.png"), "--quiet"])
    assert drawn == ["constant_velocity", "idm"]
