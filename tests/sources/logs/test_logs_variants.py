"""Releases and splits of the formats beside those that `log_files` writes."""

import codecs
import gzip
import json
import pickle
import re
import zipfile
from pathlib import Path

import log_files
import numpy as np
import pytest

from regents_cosim.errors import LogError
from regents_cosim.geometry.frames import wrap
from regents_cosim.sources.logs.formats import CompanionFiles
from regents_cosim.sources.logs.record import record_log, scenes_of
from regents_cosim.sources.logs.roads.road import NO_MAP
from regents_cosim.sources.logs.scene import agent_with_size


def only(path, **keywords):
    (scene,) = [scene for _, _, scene in scenes_of(path, **keywords)]
    return scene


# --- Waymo, GPUDrive, ScenarioNet ---------------------------------------------------------------


def test_packed_records_are_unpacked(tmp_path):
    path = log_files.write_waymo(tmp_path)
    packed = tmp_path / "packed.tfrecord.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert [scene.name for _, _, scene in scenes_of(packed)] == ["first", "second"]
    packed.write_bytes(packed.read_bytes()[:-20])
    with pytest.raises(LogError, match="gzip data is damaged or cut off"):
        list(scenes_of(packed, "waymo"))


def test_a_tf_example_to_be_predicted_has_no_future(tmp_path):
    scene = only(log_files.write_waymo_example(tmp_path, future=False))
    assert {len(track.step) for track in scene.tracks} == {11}


def test_gpudrive_without_an_ego_and_lanes_without_an_id(tmp_path):
    content = log_files.gpudrive(3)
    content["metadata"]["sdc_track_index"] = None
    lane = next(i for i, road in enumerate(content["roads"]) if road["type"] == "lane")
    content["tl_states"] = {str(lane): {"state": ["stop"] * 91, "x": [0.0] * 91, "y": [0.0] * 91}}
    (tmp_path / "a.json").write_text(json.dumps(content))
    scene = only(tmp_path / "a.json")
    assert scene.ego is None
    assert not {name for light in scene.signals for name in light.lanes} & {one.id for one in scene.road.lanes}


@pytest.mark.parametrize("kind", [list, np.array])
def test_lights_of_nuplan_have_colours(kind, tmp_path):
    content = log_files.scenarionet()
    shown = ["TRAFFIC_LIGHT_RED"] * 40 + ["TRAFFIC_LIGHT_GREEN"] * 40 + ["TRAFFIC_LIGHT_YELLOW"] * 11
    content["dynamic_map_states"]["1"]["state"]["object_state"] = kind(shown)
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(content, protocol=5))
    (light,) = only(tmp_path / "a.pkl").signals
    assert light.letters == 40 * "r" + 40 * "G" + 11 * "y"


def test_a_file_without_a_road_says_so(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps(log_files.gpudrive(3) | {"roads": []}))
    assert NO_MAP in only(tmp_path / "a.json").notes
    (tmp_path / "a.json").write_text(json.dumps(log_files.gpudrive(3)))
    assert NO_MAP not in only(tmp_path / "a.json").notes


@pytest.mark.parametrize("lapse", ["gone", "jumps"])
def test_an_ego_with_a_lapse_is_recorded_before_and_after_it(lapse, tmp_path):
    content = log_files.gpudrive(3)
    ego = content["objects"][0]
    if lapse == "gone":
        ego["valid"][40:45] = [False] * 5
    else:
        for place in ego["position"][40:]:
            place["x"] += 6.0
    (tmp_path / "a.json").write_text(json.dumps(content))
    scenarios = record_log(tmp_path / "a.json", tell=lambda line: None)
    assert {one.ego.id for one in scenarios} == {"11"}
    assert [one.provenance.begin_s for one in scenarios] == ([4.5] if lapse == "gone" else [4.1])


@pytest.mark.parametrize("protocol", [2, 3])
def test_pickles_of_older_protocols(protocol, tmp_path):
    """Protocol 2 writes bytes as calls of `_codecs.encode`, and sets as calls of `set`."""
    (tmp_path / "new.pkl").write_bytes(pickle.dumps(log_files.scenarionet()))
    (tmp_path / "old.pkl").write_bytes(pickle.dumps(log_files.scenarionet(), protocol=protocol))
    new, old = only(tmp_path / "new.pkl"), only(tmp_path / "old.pkl")
    assert [(track.agent, track.x.tolist()) for track in old.tracks] == [
        (track.agent, track.x.tolist()) for track in new.tracks
    ]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be"])
def test_text_as_windows_writes_it(encoding, tmp_path):
    def rewrite(path):
        text = path.read_bytes().decode().replace("\n", "\r\n")
        mark = codecs.BOM_UTF16_BE if encoding == "utf-16-be" else b""
        path.write_bytes(mark + text.encode(encoding))
        return path

    (tmp_path / "a.json").write_text(json.dumps(log_files.gpudrive(3)))
    assert len(only(rewrite(tmp_path / "a.json")).tracks) == 4
    table = log_files.write_table(tmp_path)
    rewrite(tmp_path / "mine.toml")
    assert len(only(rewrite(table)).tracks) == 4
    assert len(only(rewrite(log_files.write_commonroad(tmp_path))).tracks) == 4


# --- tables ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("columns", [18, 24])
def test_ngsim_as_first_published_has_no_header(columns, tmp_path):
    table = only(log_files.write_ngsim(tmp_path))
    text = only(log_files.write_ngsim_text(tmp_path, columns))
    for one, other in zip(table.tracks, text.tracks, strict=True):
        assert one.agent == other.agent
        np.testing.assert_allclose([one.x, one.y, one.yaw], [other.x, other.y, other.yaw], atol=1e-4)


def test_tables_without_a_line_of_names(tmp_path):
    """As those of ETH and UCY: numbers between white space."""
    lines = [
        f"  {frame * 10:.1f}   {name}.0  {frame + 5.0 * name:6.2f}\t 1.0" for frame in range(20) for name in (1, 2)
    ]
    (tmp_path / "eth.txt").write_text("\n".join(lines).replace("\t", " ") + "\n")
    mapping = 'time = "frames"\ndt = 0.04\nheader = ["frame", "who", "x", "y"]\n'
    (tmp_path / "eth.toml").write_text(f'{mapping}[columns]\ntime = "frame"\nid = "who"\n')
    scene = only(tmp_path / "eth.txt")
    assert [len(track.step) for track in scene.tracks] == [20, 20]
    assert scene.tracks[1].x[0] == 10.0


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_one_column_may_be_both_length_and_width(ending, tmp_path):
    """Of more rows than are read at a time."""
    half = 26_000
    rows = [(name, step / 10, step / 100, 3.0 * name, 0.5 * name) for name in (1, 2) for step in range(half)]
    path = log_files.write_rows(tmp_path / "a.csv", "id,time,x,y,across", rows)
    (tmp_path / "a.toml").write_text('[columns]\nlength = "across"\nwidth = "across"\n')
    if ending == "parquet":
        table = pytest.importorskip("polars").read_csv(path)
        path.unlink()
        path = path.with_suffix(".parquet")
        table.write_parquet(path)
    assert [(one.agent.length, one.agent.width) for one in only(path).tracks] == [(0.5, 0.5), (1.0, 1.0)]


def test_a_size_that_some_rows_lack_is_that_of_the_others(tmp_path):
    rows = [("a", step / 10, step, 0, 12.5 if step % 3 else "", 2.5) for step in range(20)]
    scene = only(log_files.write_rows(tmp_path / "a.csv", "id,time,x,y,length,width", rows))
    assert (scene.tracks[0].agent.length, scene.tracks[0].agent.width) == (12.5, 2.5)


@pytest.mark.parametrize(("separator", "row"), [(",", "1,0,1,5,2,0"), (";", "1;0;1;5;2;0"), (" ", "1 0 1 5 2 0")])
def test_rows_of_more_fields_than_columns_are_refused(separator, row, tmp_path):
    (tmp_path / "a.csv").write_text(separator.join(["id", "time", "x", "y"]) + f"\n{row}\n" * 5)
    with pytest.raises(LogError, match="a row of 6 fields .*, but 4 columns"):
        only(tmp_path / "a.csv")


def test_frames_that_are_times_are_refused(tmp_path):
    """Rounded they would be a second apart, and every road user 25 times as fast."""
    path = log_files.write_rows(tmp_path / "a.csv", "id,time,x,y", [("a", 0.04 * k, 0.3 * k, 0) for k in range(99)])
    (tmp_path / "a.toml").write_text('time = "frames"\ndt = 0.04\n')
    with pytest.raises(LogError, match="not a whole number"):
        only(path)


def test_frames_of_which_a_file_keeps_every_sixth(tmp_path):
    """The second road user is seen three frames after the steps of the first, the third once."""
    rows = [(name, 6 * step + 3 * name, 2.0 * step + 50.0 * name, 0.0) for step in range(20) for name in (0, 1)]
    path = log_files.write_rows(tmp_path / "a.csv", "id,time,x,y", [*rows, (2, 15, 99.0, 0.0)])
    (tmp_path / "a.toml").write_text('time = "frames"\ndt = 0.05\n')
    scene = only(path)
    assert scene.dt == pytest.approx(0.3)
    assert [(len(track.step), len(track.breaks)) for track in scene.tracks] == [(20, 0), (19, 0), (1, 0)]
    np.testing.assert_allclose(np.diff(scene.tracks[1].x), 2.0)
    assert scene.tracks[1].x[0] == 51.0


def test_ngsim_has_one_number_for_two_vehicles_at_once(tmp_path):
    path = log_files.write_ngsim(tmp_path)
    header, *lines = path.read_text().splitlines()
    first = [line for line in lines if line.startswith("11,")]
    other = [",".join(["11", line.split(",")[1], "77", *line.split(",")[3:]]) for line in first]
    path.write_text("\n".join([header, *lines, *other]))
    assert sorted(track.agent.id for track in only(path).tracks) == ["11", "11-2", "12", "13"]


def test_a_table_in_degrees(tmp_path):
    rows = [("a", step / 10, f"{23.7 + 1e-5 * step:.6f}", "37.98", 90.0) for step in range(20)]
    path = log_files.write_rows(tmp_path / "a.csv", "id,time,lon,lat,course", rows)
    columns = '[columns]\nx = "lon"\ny = "lat"\nheading = "course"\n'
    (tmp_path / "a.toml").write_text(columns)
    with pytest.raises(LogError, match="lon and lat may be degrees"):
        only(path)
    (tmp_path / "a.toml").write_text('position = "deg"\nheading = "nav"\n' + columns)
    (track,) = only(path).tracks
    assert (track.x[0], track.y[0]) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert np.hypot(track.x[-1], track.y[-1]) == pytest.approx(
        19e-5 * np.deg2rad(6_378_137 * np.cos(np.deg2rad(37.98))), rel=3e-3
    )
    (tmp_path / "a.toml").write_text('position = "deg"\n' + columns.replace('"lon"', '"lat"', 1))
    with pytest.raises(LogError, match="expected longitude and latitude"):
        only(path)


@pytest.mark.parametrize("unit", ["nav", "deg"])
@pytest.mark.parametrize("course", [0.0, 90.0, 215.0])
@pytest.mark.parametrize(("lon", "lat"), [(5.93, 60.4), (0.07, 60.4), (5.93, -45.0)])
def test_headings_from_true_north_point_along_the_motion(lon, lat, course, unit, tmp_path):
    """At the edges of a zone of UTM, where its grid is turned by degrees against true north."""
    ahead = 1e-5 * np.arange(20)  # degrees of a great circle, about 1.1 m each
    north, east = np.cos(np.deg2rad(course)), np.sin(np.deg2rad(course)) / np.cos(np.deg2rad(lat))
    heading = course if unit == "nav" else 90.0 - course
    places = zip(lon + east * ahead, lat + north * ahead, strict=True)
    rows = [("a", step / 10, f"{x:.10f}", f"{y:.10f}", heading) for step, (x, y) in enumerate(places)]
    path = log_files.write_rows(tmp_path / "a.csv", "id,time,x,y,heading", rows)
    (tmp_path / "a.toml").write_text(f'position = "deg"\nheading = "{unit}"\n')
    (track,) = only(path).tracks
    motion = np.arctan2(np.diff(track.y), np.diff(track.x))
    np.testing.assert_allclose(np.rad2deg(wrap(track.yaw[1:] - motion)), 0.0, atol=0.3)


def test_maps_whose_root_is_osm_xy(tmp_path):
    path = log_files.write_interaction(tmp_path)
    road = path.parent / "DR_TEST.osm"
    osm = road.read_text()
    road.unlink()
    road.with_suffix(".osm_xy").write_text(osm.replace("<osm ", "<osm_xy ").replace("</osm>", "</osm_xy>"))
    assert len(only(path).road.lanes) == 2


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "git lfs pull"),
        ("car;t;east;north;v\n1;0;1;2;3\n", r"a table, of car, t, east, north, v .*a\.toml"),
    ],
)
def test_files_that_lack_something_say_what(content, said, tmp_path):
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(LogError, match=said):
        only(tmp_path / "a.csv")


def test_a_column_without_a_name(tmp_path):
    """As pandas writes the index."""
    rows = [f"{step}\t1\t{step / 10}\t{step}\t0" for step in range(20)]
    (tmp_path / "a.csv").write_text("\n".join(["\tid\ttime\tx\ty", *rows]))
    (track,) = only(tmp_path / "a.csv").tracks
    assert (track.agent.id, track.x[-1], track.y[-1]) == ("1", 19.0, 0.0)


@pytest.mark.parametrize("split", ["train", "val", "obs", "train_17"])
def test_splits_of_interaction_find_their_map(split, tmp_path):
    path = log_files.write_interaction(tmp_path)
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps/DR_TEST.osm").write_text(log_files.osm())
    (tmp_path / "maps/DR_TES.osm").write_text("<osm/>")
    header, *rows = path.read_text().splitlines()
    one = tmp_path / "recorded" / split / "sorted" / f"DR_TEST_{split}.csv"
    one.parent.mkdir(parents=True)
    one.write_text("\r\n".join([f"case_id,{header},track_to_predict", *(f"1.0,{row},0.0" for row in rows)]))
    assert len(only(one).road.lanes) == 2


@pytest.mark.parametrize("rate", [24, 25, 29.97, 30, 60])
@pytest.mark.parametrize("digits", [3, 7])
def test_any_rate_of_a_table(rate, digits, tmp_path):
    """Of half an hour, in which steps of 0.0333 s and of 1 / 30 s are far apart."""
    times = np.array([*range(200), *range(round(1800 * rate), round(1801 * rate))]) / rate
    rows = [(name, round(time, digits), 8.0 * time + 20.0 * name, 0.0) for name in range(2) for time in times]
    scene = only(log_files.write_rows(tmp_path / "a.csv", "id,time,x,y", rows))
    assert scene.dt == pytest.approx(1 / rate, rel=1e-4)
    for track in scene.tracks:
        assert len(track.breaks) == 1
        speed = np.diff(track.x[:190]) / scene.dt
        np.testing.assert_allclose(speed, 8.0, rtol=1e-3 if digits > 3 else 0.08)


def test_sizes_that_scenarionet_lacks_at_some_instants(tmp_path):
    content = log_files.scenarionet()
    track = next(one for one in content["tracks"].values() if one["type"] == "VEHICLE")
    steps = len(track["state"]["valid"])
    track["state"] |= {"length": np.where(np.arange(steps) % 4, 6.25, np.nan), "width": np.full(steps, 2.25)}
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(content))
    assert (6.25, 2.25) in [(one.agent.length, one.agent.width) for one in only(tmp_path / "a.pkl").tracks]


def test_the_rate_of_scenarionet(tmp_path):
    content = log_files.scenarionet()
    content["metadata"]["ts"] = np.arange(91) / 30
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(content))
    assert only(tmp_path / "a.pkl").dt == pytest.approx(1 / 30, rel=1e-6)
    content["metadata"]["ts"] = 0.1 * np.arange(91) + 0.00025 * np.arange(91)  # as in files of Waymo
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(content))
    assert only(tmp_path / "a.pkl").dt == 0.1


def test_an_id_at_two_places_at_once_is_refused(tmp_path):
    rows = [(name, step / 10, 10.0 * name + step, 0.0) for name in range(3) for step in range(90)]
    again = [(0, time, x, y + 50.0) for name, time, x, y in rows if name == 0]
    path = log_files.write_rows(tmp_path / "a.csv", "id,time,x,y", rows + again)
    with pytest.raises(LogError, match="90 times the road user '0' is at two places at once"):
        only(path)
    path = log_files.write_rows(tmp_path / "a.csv", "id,time,x,y", rows + again[:5] + rows)
    assert {len(track.step) for track in only(path).tracks} == {90}


def test_kinds_of_a_table_are_words_of_the_data_sets(tmp_path):
    kinds = ["Car", "van ", "cyclist", "Pedestrian", "tram", "other"]
    rows = [(name, step / 10, 10.0 * name + step, 0.0, kind) for name, kind in enumerate(kinds) for step in range(9)]
    scene = only(log_files.write_rows(tmp_path / "a.csv", "id,time,x,y,kind", rows))
    assert [track.agent.kind for track in scene.tracks] == ["car", "car", "bicycle", "pedestrian", "other", "other"]
    assert any("taken as other: tram " in note for note in scene.notes)


def test_sizes_that_are_swapped_or_thin():
    def size(kind, *size):
        agent = agent_with_size("a", kind, *size)
        return agent.length, agent.width

    assert size("car", 1.8, 4.5) == (4.5, 1.8)
    assert size("car", 1.5, 2.0) == (1.5, 2.0)  # a part of it is seen
    assert size("other", 1.8, 4.5) == (1.8, 4.5)
    assert size("other", 0.01, 0.8) == (0.05, 0.8)
    assert size("car", 0.0, 2.0) == (4.7, 2.0)


def test_sind_writes_pedestrain(tmp_path):
    folder = log_files.write_sind(tmp_path).parent
    walkers = folder / "Ped_smoothed_tracks.csv"
    walkers.write_text(walkers.read_text().replace("pedestrian", "pedestrain"))
    assert "pedestrian" in {track.agent.kind for track in only(folder).tracks}


def test_an_archive_is_named(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("a.csv", "id,time,x,y")
    with pytest.raises(LogError, match="this is a zip archive"):
        only(tmp_path / "a.zip")


def test_a_pointer_of_git_lfs_is_said(tmp_path):
    (tmp_path / "a.parquet").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:38af\nsize 8005836\n")
    with pytest.raises(LogError, match="this is a pointer of Git LFS"):
        record_log(tmp_path / "a.parquet")


def test_pointers_of_git_lfs_beside_logs_are_named(tmp_path):
    log_files.write_ngsim(tmp_path)
    (tmp_path / "more").mkdir()
    for name in ("b.parquet", "more/a.csv"):
        (tmp_path / name).write_text("version https://git-lfs.github.com/spec/v1\noid sha256:38af\nsize 8005836\n")
    told = []
    assert len(list(scenes_of(tmp_path, tell=told.append))) == 1
    assert told == [
        f"{tmp_path}: 2 pointers of Git LFS in place of files, which are left out: b.parquet ... (fetch with "
        "`git lfs pull`)"
    ]
    with pytest.raises(LogError, match=r"1 pointer of Git LFS in place of files.*: a\.csv \(fetch"):
        record_log(tmp_path / "more")


def test_what_an_editor_deleted_from_a_map_is_gone(tmp_path):
    folder = log_files.write_interaction(tmp_path).parent
    road = folder / "DR_TEST.osm"
    road.write_text(road.read_text().replace("<relation id='2'", "<relation id='2' action='delete'"))
    assert [lane.id for lane in only(folder).road.lanes] == ["1"]


def test_links_that_lead_back_are_not_followed(tmp_path):
    path = log_files.write_ngsim(tmp_path)
    for name in "ab":
        (tmp_path / name).symlink_to(tmp_path)
    assert [one for one, _, _ in scenes_of(tmp_path)] == [path]


def test_the_file_that_is_damaged_is_named(tmp_path):
    path = log_files.write_sind(tmp_path)
    road = path.parent / "map.osm"
    road.write_text(road.read_text().replace("ref='101'", "ref='999'"))
    with pytest.raises(LogError, match=r"map\.osm: damaged, or no lanelet2 map"):
        only(path)
    path = log_files.write_levelx(tmp_path)
    (tmp_path / "00_tracksMeta.csv").write_bytes(b"\xff\xff")
    with pytest.raises(LogError, match=r"00_tracksMeta\.csv: truncated or damaged CSV"):
        only(path)


# --- CommonRoad -----------------------------------------------------------------------------------


def lanelet(name, x, y, *types, onward=(), lights=()):
    """20 m long, from (x, 0) to (x + 20, y)."""
    bounds = "".join(
        f"<{side}Bound>"
        + "".join(f"<point><x>{px}</x><y>{py + off}</y></point>" for px, py in ((x, 0), (x + 20, y)))
        + f"</{side}Bound>"
        for side, off in (("left", 2), ("right", -2))
    )
    refs = "".join(f'<successor ref="{one}"/>' for one in onward)
    words = "".join(f"<laneletType>{one}</laneletType>" for one in types)
    stand = "".join(f'<trafficLightRef ref="{one}"/>' for one in lights)
    return f'<lanelet id="{name}">{bounds}{refs}{words}{stand}</lanelet>'


def light(name, direction, *colors):
    cycle = "".join(f"<cycleElement><duration>20</duration><color>{color}</color></cycleElement>" for color in colors)
    return f'<trafficLight id="{name}"><cycle>{cycle}</cycle><direction>{direction}</direction></trafficLight>'


def crossing(tmp_path, *lights):
    """A lanelet that goes on straight (302) and to the left (303), beside the traffic of `log_files`."""
    names = [re.findall(r'id="(\d+)"', one)[0] for one in lights]
    added = (
        lanelet(301, 300, 0, "urban", onward=(302, 303), lights=names) + lanelet(302, 320, 0, "urban")
        + lanelet(303, 320, 15, "urban", "intersection") + lanelet(304, 400, 0, "urban", "crosswalk")
        + "".join(lights) + '<intersection id="7"><incoming id="8"><incomingLanelet ref="301"/>'
        '<successorsStraight ref="302"/><successorsLeft ref="303"/></incoming></intersection>'
    )  # fmt: skip
    path = tmp_path / "a.xml"
    path.write_text(log_files.commonroad().replace("</commonRoad>", f"{added}</commonRoad>"))
    return path


def test_lights_of_commonroad_hold_up_their_direction(tmp_path):
    path = crossing(tmp_path, light(61, "left", "red", "green"), light(62, "straightRight", "green", "red"))
    (scenario, *_) = record_log(path, tell=lambda line: None)
    assert {(one.source, one.target): one.signal for one in scenario.road.connections} == {
        ("301", "302"): "62", ("301", "303"): "61",
    }  # fmt: skip
    assert {one.id: one.changes[0][1] for one in scenario.signals} == {"61": "r", "62": "g"}


def test_a_light_of_commonroad_for_all_directions(tmp_path):
    (scenario, *_) = record_log(crossing(tmp_path, light(61, "all", "red")), tell=lambda line: None)
    assert {one.signal for one in scenario.road.connections} == {"61"}


def test_lanelets_of_commonroad_have_several_types(tmp_path):
    lanes = {one.id: one.junction for one in only(crossing(tmp_path)).road.lanes}
    assert lanes == {"1": False, "2": False, "301": False, "302": True, "303": True}


def test_what_stands_in_commonroad_is_there_as_long_as_the_ego(tmp_path):
    path = tmp_path / "a.xml"
    whole = re.sub("<trajectory>.*?</trajectory>", "", log_files.commonroad()).replace("dynamicObs", "staticObs")
    path.write_text(whole)
    scene = only(path)
    assert len({tuple(track.step.tolist()) for track in scene.tracks}) == 1 < len(scene.tracks[0].step)
    path.write_text(re.sub("<planningProblem.*</planningProblem>", "", log_files.commonroad()))
    assert only(path).ego is None


def test_goals_of_commonroad_beyond_the_first_are_told(tmp_path):
    path = tmp_path / "a.xml"
    goal = "<goalState><time><exact>50</exact></time></goalState></planningProblem>"
    path.write_text(log_files.commonroad().replace("</planningProblem>", goal))
    assert any("2 goals: the ego drives to the first" in note for note in only(path).notes)
    path.write_text(log_files.commonroad().replace('Size="0.2"', 'Size="0"'))
    with pytest.raises(LogError, match="timeStepSize of 0 s, expected more than 0"):
        only(path)


ROWS = "".join(f"{who},{k / 10},{k},{3 * who}\n" for who in (1, 2) for k in range(60))


def test_a_log_is_read_from_inside_its_folder(tmp_path, monkeypatch):
    (tmp_path / "tracks.csv").write_text(f"id,time,x,y\n{ROWS}")
    (tmp_path / "deeper").mkdir()
    for here, path in ((tmp_path, "."), (tmp_path / "deeper", "..")):
        monkeypatch.chdir(here)
        assert only(Path(path)).name == "tracks"


def test_a_log_that_is_a_folder_has_its_name_inside_it_too(tmp_path, monkeypatch):
    path = log_files.write_argoverse2_motion(tmp_path)
    folder = path if path.is_dir() else path.parent
    outside = only(folder).name
    monkeypatch.chdir(folder)
    assert only(Path(".")).name == outside


def test_columns_that_are_named_make_a_file_a_table(tmp_path):
    (tmp_path / "a.csv").write_text(f"who,when,east,north\n{ROWS}")
    names = tmp_path / "names.toml"
    names.write_text('[columns]\nid = "who"\ntime = "when"\nx = "east"\ny = "north"\n')
    assert len(only(tmp_path / "a.csv", beside=CompanionFiles(columns=names)).tracks) == 2


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
@pytest.mark.parametrize("kind", ["Datetime", "Duration"])
def test_dates_count_seconds_whatever_their_unit(kind, unit, tmp_path):
    pl = pytest.importorskip("polars")
    (tmp_path / "a.csv").write_text(f"id,time,x,y\n{ROWS}")
    table = pl.read_csv(tmp_path / "a.csv")
    time = (pl.col("time") * 1000 + 1.7e12).round().cast(pl.Int64)
    table.with_columns(time.cast(getattr(pl, kind)("ms")).cast(getattr(pl, kind)(unit))).write_parquet(
        tmp_path / "b.parquet"
    )
    scene = only(tmp_path / "b.parquet")
    assert scene.dt == pytest.approx(0.1)
    assert scene.begin_s == pytest.approx(1.7e9, abs=1e-3)
    assert [len(track.step) for track in scene.tracks] == [60, 60]
