"""Policies by their files: what CleanRL saves, and what a user is told of a file that does not do."""

import json
import pickle
import sys
import zipfile

import pytest
from scenes import scene

from regents_cosim.errors import DriveError, MissingDependencyError, PlannerError
from regents_cosim.replays.highway.replay import drive_in_highway
from regents_cosim.simulators.highway.agents import find_agent

CASE = scene((0.0, 0.0, 10.0), (30.0, 3.2, 10.0), steps=21)
DISCRETE = {"observation": {"type": "Kinematics"}, "action": {"type": "DiscreteMetaAction"}, "policy_frequency": 1}
CONTINUOUS = {"observation": {"type": "Kinematics"}, "action": {"type": "ContinuousAction"}}


def saved(folder, part, actions, config):
    """As CleanRL's scripts build and save a network; its answer is the last action, whatever it sees."""
    torch = pytest.importorskip("torch", reason="torch is an extra")
    nn, between = torch.nn, torch.nn.ReLU if part == "network" else torch.nn.Tanh
    layers = nn.Sequential(nn.Linear(25, 8), between(), nn.Linear(8, 8), between(), nn.Linear(8, len(actions)))
    with torch.no_grad():
        layers[4].weight.zero_()
        layers[4].bias.copy_(torch.tensor(actions))
    model = nn.Module()
    setattr(model, part, layers)
    path = folder / "run.cleanrl_model"
    torch.save(model.state_dict(), path)
    path.with_suffix(".json").write_text(json.dumps(config))
    return path


@pytest.mark.slow
@pytest.mark.parametrize("part", ["network", "actor"])
def test_a_policy_of_cleanrl_drives_by_its_file(tmp_path, part):
    path = saved(tmp_path, part, [0.0, 0.0, 0.0, 1.0, 0.0], DISCRETE)
    tracks = drive_in_highway(CASE, str(path)).tracks
    assert tracks.speed[0, -1] > 15.0, "it answers FASTER"


@pytest.mark.slow
def test_a_policy_of_continuous_actions(tmp_path):
    tracks = drive_in_highway(CASE, str(saved(tmp_path, "actor_mean", [-0.5, 0.0], CONTINUOUS))).tracks
    assert tracks.speed[0, -1] < 6.0, "it brakes"


def test_it_computes_what_the_network_would(tmp_path):
    torch = pytest.importorskip("torch", reason="torch is an extra")
    layers = torch.nn.Sequential(torch.nn.Linear(3, 4), torch.nn.ReLU(), torch.nn.Linear(4, 5))
    model = torch.nn.Module()
    model.network = layers
    path = tmp_path / "run.cleanrl_model"
    torch.save(model.state_dict(), path)
    path.with_suffix(".json").write_text("{}")
    agent = find_agent(str(path))
    for seen in torch.randn(20, 3):
        assert agent.act(seen.numpy()) == int(layers(seen).argmax())


def test_a_network_for_other_observations_is_told_what_it_gets(tmp_path):
    more = {**DISCRETE, "observation": {"type": "Kinematics", "vehicles_count": 9}}
    path = saved(tmp_path, "network", [0.0] * 5, more)
    said = "its network takes 25 numbers, an observation has 45 here: expected the `observation` of its .* in run.json"
    with pytest.raises(DriveError, match=said):
        drive_in_highway(CASE, str(path))


def test_a_package_that_is_not_installed_is_missing(tmp_path, monkeypatch):
    path = tmp_path / "run.zip"
    path.with_suffix(".json").write_text("{}")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("data", json.dumps({"policy_class": {"__module__": "stable_baselines3.dqn.policies"}}))
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(MissingDependencyError, match="needs stable_baselines3: pip install stable-baselines3"):
        find_agent(str(path))


def test_the_shape_of_a_picture_may_stand_in_the_settings(tmp_path):
    seen = {"type": "GrayscaleObservation", "observation_shape": [40, 20], "stack_size": 2, "weights": [0.3, 0.6, 0.1]}
    path = saved(tmp_path, "network", [0.0] * 5, {"observation": seen, "features_range": {"x": [-9, 9]}})
    assert find_agent(str(path)).config["observation"]["observation_shape"] == (40, 20)


def test_a_file_that_does_not_do_is_explained(tmp_path):
    with pytest.raises(PlannerError, match="there is no such file"):
        find_agent(str(tmp_path / "none.zip"))
    path = tmp_path / "run.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("data", "{}")
    with pytest.raises(PlannerError, match="run.json is not beside it, expected the configuration"):
        find_agent(str(path))
    path.with_suffix(".json").write_text("[1]")
    with pytest.raises(PlannerError, match="expected a configuration of highway-env as JSON"):
        find_agent(str(path))
    path.with_suffix(".json").write_text("{}")
    for data in ("{}", "[]"):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("data", data)
        with pytest.raises(PlannerError, match="no model that stable-baselines3 has saved"):
            find_agent(str(path))


@pytest.mark.parametrize("module", ["__main__", "beside.policies", "stable_baselines3.policies"])
def test_no_module_is_imported_because_a_zip_names_it(module, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "beside.py").write_text("raise SystemExit")
    path = tmp_path / "run.zip"
    path.with_suffix(".json").write_text("{}")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("data", json.dumps({"policy_class": {"__module__": module}}))
    with pytest.raises(PlannerError, match=rf"its class is of {module}, .* expected highway:FILE.py:POLICY"):
        find_agent(str(path))


def test_what_is_no_weights_is_refused_without_advice_to_run_it(tmp_path):
    pytest.importorskip("torch", reason="torch is an extra")
    path = tmp_path / "run.cleanrl_model"
    path.write_bytes(pickle.dumps({"network.0.weight": print}))
    path.with_suffix(".json").write_text("{}")
    with pytest.raises(PlannerError, match="run.cleanrl_model: expected the weights of CleanRL's dqn"):
        find_agent(str(path))
