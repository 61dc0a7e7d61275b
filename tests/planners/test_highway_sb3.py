"""The example of a policy trained with stable-baselines3, from training to replay."""

import shutil
from pathlib import Path

import pytest
from places import SUPPORT

from regents_cosim.evaluation.drives.driving import drive_each
from regents_cosim.replays.replay import replay
from regents_cosim.sources.highway import HighwayRecordingJob, record_episodes
from regents_cosim.sources.windows import Windows

EXAMPLE = SUPPORT / "highway_dqn.py"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_trained_policy_drives_and_is_put_to_the_test(tmp_path):
    pytest.importorskip("stable_baselines3", reason="needs the extra sb3")
    example = shutil.copy(EXAMPLE, tmp_path)
    code: dict = {"__name__": "example", "__file__": str(example)}
    exec(compile(Path(example).read_text(), str(example), "exec"), code)
    code["train"](300)
    policy = f"{example}:Trained"
    (case,) = record_episodes(HighwayRecordingJob("highway-fast-v0", policy, Windows(1, 0, 3.0, company=1)))
    (drive,) = drive_each([case], f"highway:{policy}", where="highway")
    assert drive.completion > 0.5
    result = replay(case, "highway", planner=f"highway:{policy}")
    assert result.position_error_m[1:].max() == 0.0
    assert result.replayed.tracks.steps == 31
