"""Cases of logs are what their log says, or name what they lack."""

import contextlib
from dataclasses import replace
from pathlib import Path

import log_files
import numpy as np
import pytest
from comparison import compare_with_log
from log_files import FORMATS
from params import slow
from places import DATA

from regents_cosim.errors import NoWindowError
from regents_cosim.sources.logs.record import record_log
from regents_cosim.sources.windows import Windows

SAME_M, SAME_DEG = 0.01, 0.1


def assert_faithful(log: Path, count: int, horizon_s: float) -> None:
    found = record_log(log, Windows(horizon_s=horizon_s, count=count, prefer="none"), tell=lambda _: None)
    for case, one in zip(found, compare_with_log(found, log), strict=True):
        assert one.unexplained(case) == {}
        assert one.compared >= 20
        assert one.farthest_m <= SAME_M, one
        assert one.most_turned_deg <= SAME_DEG, one
        assert one.most_resized_m == 0.0, one


@pytest.mark.slow
@pytest.mark.parametrize(
    "folder", ["womd/json", "womd/proto", "scenarionet", "interaction", "commonroad", "argoverse2/motion"]
)
def test_windows_of_public_logs(folder):
    logs = sorted((DATA / folder).iterdir()) if (DATA / folder).is_dir() else []
    if not logs:
        pytest.skip(f"no {DATA / folder} (REGENTS_DATA names the folder of recordings and cities)")
    for log in logs[:12]:
        with contextlib.suppress(NoWindowError):
            assert_faithful(log, 1, 8.0)


@pytest.mark.parametrize("name", [slow(name) if name.startswith("argoverse2") else name for name in FORMATS])
def test_windows_of_every_format_hold_what_their_log_does(name, tmp_path):
    assert_faithful(log_files.write(name, tmp_path), 2, 4.0)


ROWS = {  # x of b at every step; it leaps to and fro, and is not seen for a while
    "a": 9.0 * np.arange(60) / 10,
    "b": 20.0 + 0.9 * np.arange(60) + 5.0 * (np.arange(60) == 20),
    "c": 40.0 + 0.9 * np.arange(60),
}


@pytest.fixture
def leaping(tmp_path):
    log = tmp_path / "leaping.csv"
    rows = [
        f"{name},{k / 10:.1f},{x:.2f},0.0,0.0,4.5,1.8"
        for name, way in ROWS.items()
        for k, x in enumerate(way.tolist())
        if not (name == "c" and 25 <= k < 30)
    ]
    log.write_text("\n".join(["id,time,x,y,heading,length,width", *rows]))
    return log


def test_jumps_and_gaps_stand_in_the_ledger(leaping):
    (case,) = record_log(leaping, Windows(horizon_s=5.0, count=1), ego="a", tell=lambda _: None)
    entries = {one.reason: one.ids for one in case.provenance.left_out}
    assert entries == {"jump": ("b",), "gap": ("c",)}
    (one,) = compare_with_log([case], leaping)
    assert one.missing["b"] >= 1
    assert "c" not in one.missing, "the log has it not either"
    assert one.unexplained(case) == {}


def test_what_a_case_does_not_say_is_found(leaping):
    (case,) = record_log(leaping, Windows(horizon_s=5.0, count=1), ego="a", tell=lambda _: None)
    (one,) = compare_with_log([case], leaping)
    silent = replace(case, provenance=replace(case.provenance, left_out=()))
    assert "b" in one.unexplained(silent)


def test_a_case_that_is_elsewhere_shows(leaping):
    (case,) = record_log(leaping, Windows(horizon_s=5.0, count=1), ego="a", tell=lambda _: None)
    tracks = case.tracks
    off = replace(
        tracks, x=tracks.x + np.array([[0.0], [0.0], [0.3]]) * tracks.valid, yaw=tracks.yaw + 0.1 * tracks.valid
    )
    agents = (replace(case.agents[0], length=5.0), *case.agents[1:])
    (one,) = compare_with_log([replace(case, tracks=off, agents=agents)], leaping)
    assert (one.farthest, one.farthest_m) == ("c", pytest.approx(0.3))
    assert one.most_turned_deg == pytest.approx(np.rad2deg(0.1))
    assert (one.most_resized, one.most_resized_m) == ("a", pytest.approx(0.5))
