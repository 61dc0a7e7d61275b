"""The example of a policy trained with stable-baselines3, from training to replay."""

import base64
import json
import re
import shutil
import zipfile
from pathlib import Path

import gymnasium
import highway_env  # noqa: F401  registers the environments
import numpy as np
import pytest
from places import SUPPORT
from scenes import platoon

from regents_cosim.errors import PlannerError
from regents_cosim.evaluation.drives.driving import drive_each
from regents_cosim.replays.replay import replay
from regents_cosim.simulators.highway.agents import find_agent
from regents_cosim.sources.highway import record_episodes
from regents_cosim.sources.windows import Windows

EXAMPLE = SUPPORT / "highway_dqn.py"
CASE = platoon()
CONFIG = {"observation": {"type": "Kinematics"}, "action": {"type": "DiscreteMetaAction"}, "policy_frequency": 1}
PLAIN = """
from pathlib import Path
from stable_baselines3 import DQN
model = DQN.load(Path(__file__).with_name("DQN.zip"), device="cpu")
"""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_trained_policy_drives_and_is_put_to_the_test(tmp_path):
    pytest.importorskip("stable_baselines3", reason="needs the extra sb3")
    example = shutil.copy(EXAMPLE, tmp_path)
    code: dict = {"__name__": "example", "__file__": str(example)}
    exec(compile(Path(example).read_text(), str(example), "exec"), code)
    code["train"](300)
    policy = f"{example}:Trained"
    (case,) = record_episodes("highway-fast-v0", policy, Windows(1, 0, 3.0, company=1))
    (drive,) = drive_each([case], f"highway:{policy}", where="highway")
    assert drive.completion > 0.5
    result = replay(case, "highway", planner=f"highway:{policy}")
    assert result.position_error_m[1:].max() == 0.0
    assert result.replayed.tracks.steps == 31


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A model with the configuration of its training beside it, and the model alone."""
    sb3 = pytest.importorskip("stable_baselines3", reason="needs the extra sb3")
    folder = tmp_path_factory.mktemp("trained")
    env = gymnasium.make("highway-fast-v0", config=CONFIG)
    for method in ("DQN", "PPO"):
        getattr(sb3, method)("MlpPolicy", env, seed=0, device="cpu").save(folder / f"{method}.zip")
        (folder / f"{method}.json").write_text(json.dumps(CONFIG))
    (folder / "plain.py").write_text(PLAIN)
    return folder


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("model", "where"), [("DQN", "highway"), ("DQN", "mirror"), ("PPO", "mirror")])
def test_a_model_drives_by_its_file(trained, model, where):
    (drive,) = drive_each([CASE], f"highway:{trained}/{model}.zip", where=where)
    assert not drive.error


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_schedule_of_another_python_does_not_matter(trained, tmp_path):
    """As bytecode it is loaded by no other version: some raise, some end the process."""
    path = tmp_path / "PPO.zip"
    with zipfile.ZipFile(trained / "PPO.zip") as archive, zipfile.ZipFile(path, "w") as copy:
        for name in archive.namelist():
            data = archive.read(name)
            if name == "data":
                read = json.loads(data)
                for schedule in ("lr_schedule", "clip_range"):
                    read[schedule][":serialized:"] = "bm90aGluZw=="
                data = json.dumps(read)
            copy.writestr(name, data)
    path.with_suffix(".json").write_text(json.dumps(CONFIG))
    (drive,) = drive_each([CASE], f"highway:{path}", where="highway")
    assert not drive.error


MADE = {
    "RecurrentPPO": "MlpLstmPolicy", "MaskablePPO": "MlpPolicy", "TRPO": "MlpPolicy", "QRDQN": "MlpPolicy",
    "CrossQ": "MlpPolicy",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("method", MADE)
def test_a_model_of_contrib_answers_as_it_does_there(method, tmp_path):
    """Also after a second start: a recurrent one remembers an episode, and no more."""
    contrib = pytest.importorskip("sb3_contrib", reason="needs sb3-contrib")
    action = {"action": {"type": "ContinuousAction"}} if method == "CrossQ" else {}
    env = gymnasium.make("highway-fast-v0", config={**CONFIG, **action})
    model = getattr(contrib, method)(MADE[method], env, seed=0, device="cpu")
    model.save(tmp_path / "model.zip")
    (tmp_path / "model.json").write_text(json.dumps(env.unwrapped.config))
    agent = find_agent(str(tmp_path / "model.zip"))
    seen = [env.observation_space.sample() for _ in range(5)]
    for _ in range(2):
        agent.start(env, 0)
        state = None
        for one in seen:
            action, state = model.predict(one, state, deterministic=True)
            np.testing.assert_array_equal(agent.act(one), action)
    assert (state is not None) == (method == "RecurrentPPO")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_an_extractor_in_a_module_that_is_not_there_is_named(trained, tmp_path):
    """It is no reason to install stable-baselines3."""
    path = tmp_path / "PPO.zip"
    lost = base64.b64encode(b"cmy_extractor\nNet\n.").decode()
    with zipfile.ZipFile(trained / "PPO.zip") as archive, zipfile.ZipFile(path, "w") as copy:
        read = json.loads(archive.read("data")) | {"policy_kwargs": {":type:": "dict", ":serialized:": lost}}
        copy.writestr("data", json.dumps(read))
    path.with_suffix(".json").write_text(json.dumps(CONFIG))
    with pytest.raises(PlannerError, match="No module named 'my_extractor'"):
        find_agent(str(path))


LACKING = r"was trained with action_space Discrete\(5\), here it is Box.*`config`"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_model_alone_is_told_what_it_lacks(trained):
    """In the mirror it fails its case, like any planner failure; in highway-env no case can be driven."""
    (drive,) = drive_each([CASE], f"highway:{trained}/plain.py:model", where="mirror")
    assert re.search(LACKING, drive.error)
    with pytest.raises(PlannerError, match=LACKING):
        replay(CASE, "highway", planner=f"highway:{trained}/plain.py:model")
