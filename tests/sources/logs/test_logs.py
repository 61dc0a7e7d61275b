"""The same traffic in every format gives the same Scenarios."""

import itertools
import json
import pickle
from collections import Counter

import log_files
import numpy as np
import pytest
from log_files import CARS, FORMATS, LENGTH, SPEED, WALKER, WIDTH
from params import slow
from places import DATA

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.cli import run
from regents_cosim.errors import LogError, NoWindowError, RegentsError
from regents_cosim.saving import save_unlisted
from regents_cosim.sources.logs.cut import LogWindows, cut
from regents_cosim.sources.logs.formats import CompanionFiles, find_logs, format_of, formats, read_log
from regents_cosim.sources.logs.inspection import inspect_scene
from regents_cosim.sources.logs.record import origin_of, record_log, scenes_of
from regents_cosim.sources.logs.roads.road import build_road
from regents_cosim.sources.record import LogInput, record
from regents_cosim.sources.windows import Windows


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """One log of every format."""
    return {name: log_files.write(name, tmp_path_factory.mktemp(name)) for name in FORMATS}


@pytest.fixture(scope="module")
def scenes(logs):
    """The first scene of each."""
    return {name: next(read_log(path, formats()[name], CompanionFiles())) for name, path in logs.items()}


def test_every_format_is_tested():
    missing = formats().keys() - FORMATS
    assert not missing, f"write a small log of {missing} in FORMATS of tests/support/log_files.py"


@pytest.mark.parametrize("name", FORMATS)
def test_the_content_tells_the_format(logs, name, tmp_path):
    assert format_of(logs[name]).name == name
    if logs[name].is_file() and name != "table":  # that one has its mapping beside it
        renamed = tmp_path / "no_name"
        renamed.write_bytes(logs[name].read_bytes())
        assert format_of(renamed).name == name


@pytest.mark.parametrize("name", FORMATS)
def test_everybody_is_where_they_were(scenes, name):
    scene, has = scenes[name], FORMATS[name]
    tracks = {track.agent.id.removeprefix("P"): track for track in scene.tracks}
    for number, kind, x, y in log_files.motion(scene.dt):
        if number not in tracks:
            assert (kind == "pedestrian" and not has.walkers) or number == "11"
            continue
        track = tracks[number]
        assert track.agent.kind == kind
        np.testing.assert_allclose(track.x, x[track.step], atol=1e-4 if name in ("interaction", "sind") else 2e-5)
        np.testing.assert_allclose(track.y, y[track.step] - has.down_m, atol=1e-4)
        if kind == "car":
            np.testing.assert_allclose(np.cos(track.yaw), 1.0, atol=1e-6)
            if name != "argoverse2_motion":
                assert (track.agent.length, track.agent.width) == pytest.approx((LENGTH, WIDTH), abs=1e-6)


@pytest.mark.parametrize("name", FORMATS)
def test_the_road_holds_the_traffic(scenes, name):
    road = build_road(scenes[name])
    down = -FORMATS[name].down_m
    places = np.array([[x, y + down] for x in (0.0, 50.0, 100.0) for y in (-2.0, 0.0, 1.5)])
    if not FORMATS[name].road:
        assert not road.lanes, "without a map the road is where vehicles drove"
        assert road.contains(places[places[:, 1] == -2.0]).all()
    else:
        assert road.contains(places).all(), "its LoggedMap needs `edges` or `areas`, or log_files.py road=False"
        assert len(road.lanes) in (2, 3, 4)
        assert not road.contains(np.array([[50.0, 4.5 + down], [50.0, -4.5 + down]])).any()
        if name in ("waymo", "gpudrive", "commonroad", "interaction", "sind", "argoverse2_motion"):
            ahead = road.contains(np.array([[200.0, -2.0], [200.0, 2.0], [-40.0, -2.0], [-40.0, 2.0]]))
            assert ahead.all(), "the end of the map is no kerb"


@pytest.mark.parametrize("name", FORMATS)
def test_windows_at_ten_hertz(logs, name):
    scenario = record_log(logs[name], Windows(horizon_s=4.0, count=1), tell=str)[0]
    assert scenario.dt == 0.1
    assert scenario.tracks.steps == 41
    assert scenario.tracks.valid[0].all()
    np.testing.assert_allclose(scenario.tracks.speed[0], SPEED, atol=0.6 if name == "commonroad" else 0.02)
    assert scenario.provenance.source == name
    if FORMATS[name].ego:
        assert scenario.ego.id in ("11", "AV", "ego", "ego_99")
    assert len(scenario.agents) >= 3


@pytest.mark.parametrize("name", [slow("waymo"), slow("commonroad"), "interaction"])
def test_cases_are_saved_and_replayed_in_the_mirror_and_in_sumo(logs, name, tmp_path):
    from regents_cosim.replays.replay import replay

    scenario = record_log(logs[name], Windows(horizon_s=4.0, count=1), tell=str)[0]
    again = load_case(save_unlisted(scenario, tmp_path))
    assert content_hash(again) == content_hash(scenario)
    assert replay(again, "mirror").verified
    assert replay(again, "sumo").verified, "on the bare lanes of its map"


# --- windows and egos ---------------------------------------------------------------------------


def test_stride_horizon_and_count(logs):
    begins = [
        s.provenance.begin_s
        for s in record_log(logs["waymo"], Windows(horizon_s=2.0, count=99), stride_s=1.0, tell=str)
    ]
    assert begins == pytest.approx([0, 1, 2, 3, 4, 5, 6, 7] * 2)
    names = [s.id for s in record_log(logs["waymo"], Windows(horizon_s=2.0, count=99), tell=str)]
    assert len(set(names)) == len(names) == 8
    assert len(record_log(logs["waymo"], Windows(horizon_s=2.0, count=3), tell=str)) == 3


def test_a_short_log_gives_one_window_of_its_length(logs):
    (scenario,) = record_log(logs["gpudrive"], Windows(horizon_s=60.0), tell=str)
    assert scenario.tracks.steps == 91


def test_any_road_user_may_be_the_ego(logs):
    (scenario,) = record_log(logs["gpudrive"], Windows(horizon_s=8.0), ego="12", tell=str)
    assert scenario.ego.id == "12"
    with pytest.raises(NoWindowError, match="'nobody'"):
        record_log(logs["gpudrive"], ego="nobody", tell=str)


def test_the_kind_that_is_asked_for_holds_for_an_ego_that_the_log_names(logs):
    assert record_log(logs["gpudrive"], Windows(ego_kind="car"), tell=str)[0].ego.id == "11"
    with pytest.raises(NoWindowError, match="of another kind than `ego_kind` bus"):
        record_log(logs["gpudrive"], Windows(ego_kind="bus"), tell=str)


def test_an_ego_that_comes_late_begins_its_windows_late(logs):
    scenarios = record_log(logs["gpudrive"], Windows(horizon_s=8.0), ego="13", tell=str)
    assert [s.provenance.begin_s for s in scenarios] == [0.5]


def test_without_an_ego_the_seed_draws_one(logs):
    def egos(seed):
        return [s.ego.id for s in record_log(logs["interaction"], Windows(horizon_s=1.0, count=9, seed=seed), tell=str)]

    assert egos(1) == egos(1)
    assert len({name for seed in range(3) for name in egos(seed)}) == len(CARS)
    assert WALKER[0] not in egos(0)


def test_assumptions_are_told_once(logs):
    told = []
    record_log(logs["gpudrive"], tell=told.append)
    assert len(told) == len(set(told)) == 3
    assert any("radians" in note for note in told)


# --- what each format has of its own --------------------------------------------------------------


@pytest.mark.parametrize("generation", [1, 2, 3])
def test_three_generations_of_gpudrive(tmp_path, generation):
    path = log_files.write_gpudrive(tmp_path, generation)
    (scenario,) = record_log(path, tell=str)
    np.testing.assert_allclose(np.cos(scenario.tracks.yaw[scenario.tracks.valid]), 1.0)
    assert scenario.ego.id in (("11",) if generation == 3 else ("0", "1"))


def test_small_headings_without_metadata_are_told_by_the_motion(tmp_path):
    for factor, unit in ((1.0, "radians"), (180.0 / np.pi, "degrees")):
        content = log_files.gpudrive(2)
        for one in content["objects"]:  # a way that points 3 degrees to the left
            points = one["position"]
            turned = [{"x": p["x"], "y": 0.0524 * p["x"]} for p in points]
            one.update(position=turned, heading=[0.0524 * factor] * len(points), valid=[True] * len(points))
        (tmp_path / "s.json").write_text(json.dumps(content))
        scene = next(read_log(tmp_path / "s.json", formats()["gpudrive"], CompanionFiles()))
        assert unit in " ".join(scene.notes)
        np.testing.assert_allclose(scene.tracks[0].yaw, 0.0524, atol=1e-6)


def test_waymo_signals_stand_where_the_stopping_point_is(logs):
    scenario = record_log(logs["waymo"], Windows(horizon_s=8.0, count=1), tell=str)[0]
    (light,) = scenario.signals
    assert light.changes == ((0, "r"), (40, "G"))
    assert [(c.source, c.target) for c in scenario.road.connections if c.signal == light.id] == [("1", "3")]


def test_a_tf_example_is_the_same_scenario(tmp_path):
    path = log_files.write_waymo_example(tmp_path)
    scenario = record_log(path, tell=str)[0]
    assert scenario.ego.id == "11"
    assert len(scenario.agents) == 4
    np.testing.assert_allclose(scenario.tracks.speed[0], SPEED, atol=0.01)
    assert scenario.road.contains(np.array([[50.0, 0.0]])).all()


def test_the_index_of_a_folder_of_scenarionet_is_no_scenario(tmp_path):
    path = log_files.write_scenarionet(tmp_path)
    (tmp_path / "dataset_summary.pkl").write_bytes(pickle.dumps({path.name: {"id": "sn"}}))
    assert [file for file, _ in find_logs(tmp_path)] == [path]


def test_commonroad_2018b(tmp_path):
    (scenario,) = record_log(log_files.write_commonroad(tmp_path, "2018b"), tell=str)
    assert scenario.ego.id == "ego_99"
    assert scenario.target == pytest.approx((85.0, -2.0))


def test_interaction_reads_a_folder_too(logs):
    (found,) = find_logs(logs["interaction"].parent)
    assert found[0].is_dir()
    (scene,) = read_log(*found, CompanionFiles())
    assert {track.agent.id for track in scene.tracks} == {*CARS, "P14"}


def test_interaction_with_cases_is_a_scene_per_case(tmp_path):
    path = log_files.write_interaction(tmp_path)
    header, *rows = path.read_text().splitlines()
    every = [f"{case},{row}" for row in rows for case in (2.0, 1.0) if case == 1.0 or not row.startswith("13,")]
    (path.parent / "DR_TEST_train.csv").write_text("\n".join([f"case_id,{header}", *every]))
    scenes = [scene for _, _, scene in scenes_of(path.parent / "DR_TEST_train.csv")]
    assert [scene.name.rpartition("-")[2] for scene in scenes] == ["case1", "case2"]
    assert [len(scene.tracks) for scene in scenes] == [3, 2]
    assert {len(track.step) for scene in scenes for track in scene.tracks} == {91}


def test_highd_has_two_carriageways_that_run_opposite_ways(scenes):
    lanes = {lane.id: lane for lane in scenes["highd"].road.lanes}
    assert lanes["upper-0"].centre[0, 0] > lanes["upper-0"].centre[1, 0]
    assert lanes["lower-0"].centre[0, 0] < lanes["lower-0"].centre[1, 0]
    assert lanes["lower-1"].left == "lower-0"
    assert lanes["upper-0"].left == "upper-1"


def test_ngsim_tells_vehicles_with_one_number_apart(tmp_path):
    path = log_files.write_ngsim(tmp_path)
    header, *rows = path.read_text().splitlines()
    later = [row.replace('"1,118,846,', '"1,118,946,') for row in rows]
    path.write_text("\n".join([header, *rows, *later, *(row.replace("us-101", "i-80") for row in rows)]))
    scenes = {scene.name: scene for _, _, scene in scenes_of(path)}
    assert set(scenes) == {"ngsim-us-101", "ngsim-i-80"}
    assert len(scenes["ngsim-us-101"].tracks) == 2 * len(CARS)
    assert len(scenes["ngsim-i-80"].tracks) == len(CARS)


def test_a_parquet_table(tmp_path):
    pl = pytest.importorskip("polars")
    csv = log_files.write_table(tmp_path)
    pl.read_csv(csv, schema_overrides={"name": pl.String, "what": pl.String}).write_parquet(tmp_path / "mine.parquet")
    csv.unlink()
    assert record_log(tmp_path / "mine.parquet", tell=str)[0].ego.id == "11"


def test_a_mapping_with_an_unknown_key_is_refused(tmp_path):
    path = log_files.write_table(tmp_path)
    (tmp_path / "mine.toml").write_text(log_files.MAPPING.replace("anchor", "ancor"))
    with pytest.raises(LogError, match="ancor"):
        record_log(path)


def test_inspection_counts(scenes):
    found = inspect_scene(scenes["waymo"], "waymo")
    assert (found.agents, found.kinds, found.duration_s) == (4, "3 car, 1 pedestrian", 9.0)
    assert (found.overlaps, found.off_road_percent, found.max_m_s) == (0, 0.0, 10.0)


# --- refusals -------------------------------------------------------------------------------------


def test_a_format_that_does_not_exist(logs):
    with pytest.raises(RegentsError, match="expected auto or one of .*waymo"):
        record_log(logs["waymo"], format="nothing")


def test_the_error_without_polars_names_the_extra(logs, monkeypatch):
    import importlib.util

    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(RegentsError, match=r"\.\[logs\]"):
        record_log(logs["argoverse2_motion"])


def test_the_map_of_interaction_must_be_found(logs, tmp_path):
    lonely = tmp_path / "vehicle_tracks_000.csv"
    lonely.write_bytes(logs["interaction"].read_bytes())
    with pytest.raises(LogError, match="`map`"):
        record_log(lonely)
    osm = logs["interaction"].with_name("DR_TEST.osm")
    assert record_log(lonely, beside=CompanionFiles(road=osm), tell=str)


# --- recordings -----------------------------------------------------------------------------------

SAMPLES = {
    "womd/json": ("gpudrive", 16), "womd/proto": ("waymo", 3), "scenarionet": ("scenarionet", 5),
    "argoverse2/motion": ("argoverse2_motion", 2), "argoverse2/sensor": ("argoverse2_sensor", 2),
    "interaction": ("interaction", 1), "commonroad": ("commonroad", 6),
}  # fmt: skip
QUICK = ("womd/json", "commonroad")


@pytest.mark.slow
@pytest.mark.parametrize("folder", [name if name in QUICK else slow(name) for name in SAMPLES])
def test_recordings(folder):
    if not (DATA / folder).is_dir():
        pytest.skip(f"no {folder} (set REGENTS_DATA to the folder of recordings)")
    name, number = SAMPLES[folder]
    found, windows = [], []
    for file, format, scene in scenes_of(DATA / folder):
        assert format == name
        found.append(scene.name)
        if len(windows) < 2:
            share = inspect_scene(scene, format).off_road_on_map_percent
            assert share < 4.0
            windows += itertools.islice(cut(scene, LogWindows(), origin_of(file, format, scene), Counter()), 1)
    assert len(found) == len(set(found)) == number
    assert len(windows) == min(2, number)
    assert all(len(window.agents) > 3 for window in windows)


@pytest.mark.slow
def test_overlaps_are_counted_among_a_bounded_number_of_pairs(tmp_path):
    """Of 1,500 at one place there are a million pairs."""
    for many, overlaps in ((150, 150 * 149 // 2), (1500, 23_000)):
        rows = "\n".join(f"{i},{k},{9 * k},0" for i in range(many) for k in (0, 1))
        (tmp_path / "crowd.csv").write_text(f"id,time,x,y\n{rows}\n")
        ((_, name, scene),) = scenes_of(tmp_path / "crowd.csv")
        found = inspect_scene(scene, name)
        assert found.overlaps == overlaps
        assert any("pairs that come near" in note for note in found.notes) == (many > 1000)


def test_whoever_records_is_told_once_of_the_limit(tmp_path, capsys):
    log = log_files.write_gpudrive(tmp_path)
    told: list[str] = []
    found = record(LogInput(log), horizon_s=4.0, max_agents=2, tell=told.append, progress=False)
    assert {len(case.agents) for case in found} == {2}
    lines = [line for line in told if "beyond `max_agents`" in line]
    assert len(lines) == 1
    words = ["record", "--log", str(log), "--horizon", "4", "--max-agents", "2", "-o", str(tmp_path / "out")]
    assert run(words) == 0
    assert [line for line in capsys.readouterr().err.split("\n") if "beyond `max_agents`" in line] == lines


def test_where_the_ego_of_a_log_stands_another_is_drawn(tmp_path):
    content = log_files.gpudrive(3)
    content["objects"][0]["position"] = content["objects"][0]["position"][:1] * 91
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(content))
    (drawn,) = record_log(path, Windows(count=1), tell=str)
    assert drawn.ego.id != "11"
    (named,) = record_log(path, Windows(count=1), ego="11", tell=str)
    assert named.ego.id == "11"
