"""Logs that read well and would be silently wrong: units of headings, frames that come late, goals that are missing."""

import json
import os
import subprocess
import sys

import log_files
import numpy as np
import pytest

from regents_cosim.errors import LogError
from regents_cosim.sources.logs.files import polars_files
from regents_cosim.sources.logs.files.csv_columns import read_columns
from regents_cosim.sources.logs.formats import CompanionFiles
from regents_cosim.sources.logs.readers import scenarionet, table
from regents_cosim.sources.logs.record import record_log, scenes_of
from regents_cosim.sources.windows import Windows


def turning(unit):
    """Cars on a circle of 40 m, at 8 m/s, headings in `unit`."""
    rows = []
    for number in range(3):
        for step in range(60):
            angle = 0.02 * step + 2.0 * number
            x, y, yaw = 40 * np.cos(angle), 40 * np.sin(angle), angle + np.pi / 2
            heading = {"rad": yaw, "deg": np.rad2deg(yaw), "nav": 90 - np.rad2deg(yaw)}[unit]
            rows.append((number, step / 10, round(x, 4), round(y, 4), round(heading, 5)))
    return rows


def read(path):
    return next(scene for _, _, scene in scenes_of(path, "table"))


@pytest.mark.parametrize("way", ["../place.osm", "/place.osm", "link.osm"])
def test_a_table_names_no_map_outside_its_folder(tmp_path, way):
    (tmp_path / "logs").mkdir()
    (tmp_path / "place.osm").write_text(log_files.osm())
    (tmp_path / "logs" / "link.osm").symlink_to(tmp_path / "place.osm")
    path = log_files.write_rows(tmp_path / "logs" / "a.csv", "id,time,x,y,heading", turning("rad"))
    path.with_suffix(".toml").write_text(f'map = "{way}"\n')
    with pytest.raises(LogError, match="outside its folder"):
        read(path)
    (tmp_path / "logs" / "circle.osm").symlink_to("circle.osm")
    path.with_suffix(".toml").write_text('map = "circle.osm"\n')
    with pytest.raises(LogError, match="circle.osm"):
        read(path)
    path.with_suffix(".toml").write_text('map = "here.osm"\n')
    (tmp_path / "logs" / "here.osm").write_text(log_files.osm())
    assert read(path).road.lanes


@pytest.mark.parametrize("unit", ["rad", "deg", "nav"])
def test_headings_of_a_table_without_a_unit_are_told_by_the_motion(tmp_path, unit):
    path = log_files.write_rows(tmp_path / "a.csv", "id,time,x,y,heading", turning(unit))
    scene = read(path)
    (note,) = [note for note in scene.notes if "headings" in note]
    assert note.startswith(
        {"rad": "headings in radians", "deg": "headings in degrees (", "nav": "headings in degrees c"}[unit]
    )
    for track in scene.tracks:
        apart = np.angle(np.exp(1j * (track.yaw[1:] - np.arctan2(np.diff(track.y), np.diff(track.x)))))
        assert np.abs(apart).max() < 0.05


def test_a_stated_unit_that_is_wrong_is_refused(tmp_path):
    path = log_files.write_rows(tmp_path / "a.csv", "id,time,x,y,heading", turning("deg"))
    (tmp_path / "a.toml").write_text('heading = "rad"')
    with pytest.raises(LogError, match="headings and motion .* differ by .* degrees in the mean"):
        read(path)


def test_every_format_is_asked_for_headings_along_the_motion(tmp_path):
    content = log_files.gpudrive(3)
    for one in content["objects"]:
        one["heading"] = [2.0] * len(one["heading"])
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(LogError, match="headings and motion"):
        list(scenes_of(tmp_path / "a.json"))


@pytest.mark.parametrize("late_s", [0.0, 0.04])
def test_frames_that_come_late_are_no_change_of_speed(tmp_path, late_s):
    """Every fifth frame is 40 ms late, the cars drive at 5 m/s all the time."""
    rows = []
    for number in range(3):
        for step in range(90):
            time = step / 10 + (late_s if step % 5 == 2 else 0.0)
            rows.append((number, round(time, 3), round(15.0 * number + 5.0 * time, 4), 0.0))
    path = log_files.write_rows(tmp_path / "a.csv", "id,time,x,y", rows)
    said = []
    (scenario, *_) = record_log(path, format="table", tell=said.append)
    speed = scenario.tracks.speed[scenario.tracks.valid]
    assert (speed.min(), speed.max()) == pytest.approx((5.0, 5.0), abs=0.05)
    assert any("up to 40 ms off steps of 100 ms" in line for line in said) == bool(late_s)


@pytest.mark.parametrize("late_ms", [0, 30])
def test_interaction_says_when_it_moves_samples_onto_steps(tmp_path, late_ms):
    path = log_files.write_interaction(tmp_path)
    lines = path.read_text().splitlines()
    cells = [line.split(",") for line in lines]
    for row in cells[1:]:
        row[2] = str(int(row[2]) + (late_ms if int(row[1]) % 5 == 3 else 0))
    path.write_text("\n".join(",".join(row) for row in cells))
    (scene,) = [scene for _, _, scene in scenes_of(path, "interaction")]
    assert any("up to 30 ms off steps of 100 ms" in note for note in scene.notes) == bool(late_ms)


@pytest.mark.parametrize("late_us", [0, 1500, 40_000])
def test_a_waymo_example_whose_frames_come_late_is_refused(tmp_path, monkeypatch, late_us):
    def with_stamps(payload):
        found = {}
        for part, steps in (("past", range(10)), ("current", range(10, 11)), ("future", range(11, 91))):
            stamps = np.tile([100_000 * k + late_us * (k % 5 == 2) for k in steps], (128, 1))
            values = log_files.nested(1, b"".join(log_files.varint(int(v)) for v in stamps.ravel()))
            found[f"state/{part}/timestamp_micros"] = log_files.nested(3, values)
        entries = (log_files.nested(1, name) + log_files.nested(2, value) for name, value in found.items())
        return record(payload + log_files.nested(1, b"".join(log_files.nested(1, entry) for entry in entries)))

    record = log_files.record
    monkeypatch.setattr(log_files, "record", with_stamps)
    path = log_files.write_waymo_example(tmp_path)
    if late_us <= 10_000:
        assert len(next(scene for _, _, scene in scenes_of(path)).tracks) == 4
        return
    with pytest.raises(LogError, match="a time stamp is 40 ms off steps of 100 ms"):
        list(scenes_of(path))


@pytest.mark.parametrize("head", [b"\x80\x04", b"PAR1", b"ARROW1"])
def test_a_log_of_gigabytes_is_not_taken_into_memory(tmp_path, head):
    path = tmp_path / "a.bin"
    with path.open("wb") as file:
        file.write(head)
        file.truncate((1 << 30) + 1)
    with pytest.raises(LogError, match="holds more than 1024 MiB, the most that is read of it; expected a log"):
        list(scenarionet.read(path, CompanionFiles())) if head[0] == 0x80 else polars_files._read(path, (), (), ())


@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are Linux's")
def test_a_limit_that_one_works_under_makes_no_log_damaged(tmp_path):
    pytest.importorskip("polars")
    folder = log_files.write_argoverse2_motion(tmp_path)
    script = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))\n"
        "from pathlib import Path; from regents_cosim.sources.logs.files.polars_files import _read\n"
        "print(len(_read(Path(sys.argv[1]), ('position_x',), (), ())))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(next(folder.rglob("*.parquet")))], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 10


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_named_pipes_are_refused_and_not_waited_for(tmp_path):
    path = log_files.write_table(tmp_path)
    pipe = path.with_name("pipe")
    os.mkfifo(pipe)
    with pytest.raises(LogError, match="is a named pipe, expected a file"):
        list(table.read(path, CompanionFiles(columns=pipe)))
    with pytest.raises(LogError, match="is a named pipe, expected a file"):
        list(scenarionet.read(pipe, CompanionFiles()))


def test_times_without_any_step_are_refused(tmp_path):
    rng = np.random.default_rng(0)
    rows = [(1, round(t, 4), 5.0 * t, 0.0) for t in np.sort(rng.uniform(0, 9, 90))]
    path = log_files.write_rows(tmp_path / "a.csv", "id,time,x,y", rows)
    with pytest.raises(LogError, match="times do not lie on steps"):
        read(path)


def test_time_stamps_of_a_dense_log_that_jitter_are_refused(tmp_path):
    scene = log_files.scenarionet()
    scene["metadata"]["ts"][5] += 0.04
    import pickle

    (tmp_path / "a.pkl").write_bytes(pickle.dumps(scene, protocol=4))
    with pytest.raises(LogError, match="40 ms off"):
        list(scenes_of(tmp_path / "a.pkl"))


def test_a_planning_problem_without_a_goal_is_left_out(tmp_path):
    text = log_files.commonroad()
    start, end = text.index("<goalState>"), text.index("</goalState>") + len("</goalState>")
    (tmp_path / "a.xml").write_text(text[:start] + text[end:])
    said = []
    scenarios = record_log(tmp_path / "a.xml", tell=said.append)
    assert scenarios[0].ego.id in log_files.CARS
    assert any("planning problem 99 has no goal and is left out" in line for line in said)


COMMAS = {  # separator and numbers with commas, and what they are; None: one line says that it is not certain
    (";", "10,90"): 10.9, (";", "-0,5"): -0.5, (";", "1,125"): 1.125, (";", "10,"): 10.0, (";", "1,125,000"): None,
    (";", "1.125,5"): None, (";", "1.5"): 1.5, ("\t", "10,90"): 10.9, ("\t", "1,125"): None, (",", '"1,125"'): 1125.0,
    (",", '"1,118,846.5"'): 1118846.5, (",", '"10,90"'): None, (",", '"0,125"'): None, (",", '"1,125,00"'): None,
}  # fmt: skip


@pytest.mark.parametrize(("separator", "text"), COMMAS)
def test_a_comma_in_a_number_is_what_it_must_be_or_refused(tmp_path, separator, text):
    file, value = tmp_path / "a.csv", COMMAS[separator, text]
    file.write_text(separator.join("abc") + "\n" + separator.join((text, text, "2")) + "\n")
    if value is not None:
        numbers = read_columns(file, ["a", "b", "c"]).numbers
        assert [numbers[name].tolist() for name in "abc"] == [[value], [value], [2.0]]
        return
    with pytest.raises(LogError, match="what its commas mean is not certain"):
        read_columns(file, ["a", "b", "c"])


def test_a_table_with_decimal_commas_is_the_one_with_points(tmp_path):
    rows = [(i, f"{k / 10:.1f}", f"{9 * i + k:.2f}", "0.50", "4.50", "1.80") for i in range(3) for k in range(90)]
    lines = ["id;time;x;y;length;width", *(";".join(map(str, row)) for row in rows)]
    (tmp_path / "points.csv").write_text("\n".join(lines))
    (tmp_path / "commas.csv").write_text("\n".join(lines).replace(".", ","))
    (points, commas) = (
        record_log(tmp_path / f"{name}.csv", Windows(count=1), tell=print)[0] for name in ("points", "commas")
    )
    np.testing.assert_array_equal(points.tracks.x, commas.tracks.x)
    assert points.agents == commas.agents


@pytest.mark.parametrize(
    ("format", "column", "others"),
    [
        ("interaction", "psi_rad", "heading"),
        ("sind", "yaw_rad", "psi_of_somebody"),
        ("highd", "yVelocity", "yVelocity,ego_offset"),
        ("highd", "yVelocity", "yVelocity,heading"),
        ("ad4che", "ego_offset", "corner"),
        ("levelx", "yVelocity", "yVelocity,centerX"),
        ("levelx", "yVelocity", "yVelocity,yaw"),
        ("table", "course", "yaw_rad"),
    ],
)
def test_a_format_is_not_taken_for_its_neighbour(tmp_path, format, column, others):
    """A column that is not the format's own, and says where something is or points, is refused by its name."""
    path = log_files.write(format, tmp_path)
    head, *rows = path.read_text().splitlines()
    rows = [row + ",0.0" * ("," in others) for row in rows]
    path.write_text("\n".join([head.replace(column, others), *rows]))
    with pytest.raises(LogError, match=others.rpartition(",")[2]):
        list(scenes_of(path))


def test_a_plain_table_says_which_columns_it_does_not_read(tmp_path):
    path = tmp_path / "plain.csv"
    rows = [f"{who},{k / 10},{20 * who + k},0.0,truck,0.0" for who in (1, 2) for k in range(60)]
    path.write_text("\n".join(["id,time,x,y,class,yaw_rate", *rows]))
    said = []
    record_log(path, Windows(horizon_s=4.0, count=1), tell=said.append)
    assert any("class may be their kinds" in line for line in said)
    path.write_text(path.read_text().replace("yaw_rate", "yaw_rad"))
    with pytest.raises(LogError, match=r'yaw_rad may be the headings.*heading = "yaw_rad"'):
        record_log(path, Windows(horizon_s=4.0, count=1), tell=said.append)
    path.with_suffix(".toml").write_text('[columns]\nheading = "yaw_rad"\nkind = "class"\n')
    (case,) = record_log(path, Windows(horizon_s=4.0, count=1), tell=said.append)
    assert {agent.kind for agent in case.agents} == {"truck"}
