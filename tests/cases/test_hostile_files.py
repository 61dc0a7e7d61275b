"""Files of a suite that a stranger made: each is refused with one line, quickly, and without much memory."""

import gzip
import io
import os
import re
import struct
import tracemalloc
import warnings
import zipfile
from contextlib import suppress
from dataclasses import replace

import msgspec
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scenes import platoon
from test_files import attacked, judged

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.cases.map_files import load_polygons
from regents_cosim.cases.suite import load_suite
from regents_cosim.cases.track_files import load_arrays
from regents_cosim.errors import CaseError, InputError, ScenarioError
from regents_cosim.evaluation.drives.encounters import FrontPath, crossing, followings, joining
from regents_cosim.saving import SuiteWriter, save_unlisted
from regents_cosim.scenario.scenario import Agent, Tracks


@pytest.fixture
def case(tmp_path):
    return save_unlisted(attacked(), tmp_path)


def assert_refused(folder, words, most_bytes=16 << 20):
    tracemalloc.start()
    try:
        with pytest.raises(CaseError, match=words) as error:
            load_case(folder)
        assert tracemalloc.get_traced_memory()[1] < most_bytes
    finally:
        tracemalloc.stop()
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 500


def replace_map(case, change):
    """Let the case have another road map: its entries, changed."""
    (path,) = (case.parent / "maps").iterdir()
    entry = msgspec.json.decode(gzip.decompress(path.read_bytes()))
    path.write_bytes(gzip.compress(change(entry)))


def with_polygons(data):
    return lambda entry: msgspec.json.encode(entry | {"drivable": data})


# --- polygons ---------------------------------------------------------------------------------


def nested_collections(depth):
    return struct.pack("<BII", 1, 7, 1) * depth + shapely.to_wkb(shapely.Point(0, 0))


def test_collections_in_collections_do_not_reach_the_library_that_overflows(case):
    replace_map(case, with_polygons(nested_collections(200_000)))
    assert_refused(case, "geometry of type 7, expected polygons")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "cut off"),
        (b"\x01\x03", "cut off"),
        (b"\x07" + b"\x00" * 8, "no well-known binary"),
        (struct.pack("<BII", 1, 6, 2**32 - 1), "cut off"),
        (struct.pack("<BIII", 1, 3, 1, 2**32 - 1), r"end after \d+ of 13 bytes"),
        (struct.pack("<BII", 1, 6, 1) + nested_collections(2), "geometry of type 7 in a multipolygon"),
        (shapely.to_wkb(shapely.box(0, 0, 1, 1)) + b"more", "end after 93 of 97 bytes"),
        (shapely.to_wkb(shapely.Point(1, 2)), "geometry of type 1"),
        (struct.pack("<BIII4d", 1, 3, 1, 2, 0, 0, 1, 1), "cannot be read"),
    ],
)
def test_what_is_no_polygon_is_refused(data, words):
    with pytest.raises(InputError, match=words):
        load_polygons(data)


def test_polygons_with_holes_and_of_several_parts_are_read():
    one = shapely.Polygon(shapely.box(0, 0, 9, 9).exterior, [shapely.box(1, 1, 2, 2).exterior])
    many = shapely.MultiPolygon([one, shapely.box(20, 0, 30, 5)])
    for polygons in (one, many):
        for order in (0, 1):
            assert load_polygons(shapely.to_wkb(polygons, byte_order=order)).equals_exact(polygons, 0.0)


# --- sizes and kinds of file ------------------------------------------------------------------


def test_arrays_that_expand_are_refused_before_they_are_unpacked(case, monkeypatch):
    monkeypatch.setattr("regents_cosim.cases.track_files.UNPACKED_BYTES", 1 << 20)
    np.savez_compressed(case / "tracks.npz", x=np.zeros((4000, 1000)))
    assert_refused(case, "holds 31 MiB unpacked, the most that is read is 1 MiB")


def npz(*members, way=zipfile.ZIP_DEFLATED):
    buffer = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(buffer, "w", way) as packed:
        warnings.simplefilter("ignore", UserWarning)  # of a name that occurs twice
        for name, data in members:
            packed.writestr(name, data)
    return buffer.getvalue()


def npy(header, data=b"", version=1):
    text = header.encode("latin1") + b"\n"
    return b"\x93NUMPY" + bytes([version, 0]) + struct.pack("<H" if version == 1 else "<I", len(text)) + text + data


HEAD = "{'descr': %s, 'fortran_order': False, 'shape': %s}"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (
            npz(("x.npy", npy(HEAD % ("'<f8'", "(1000000, 1000000)")))),
            r"shape \[1000000, 1000000\] is not that of 0 bytes",
        ),
        (npz(("x.npy", npy(HEAD % ("'<f8'", "(-1, -1)"), bytes(8)))), "damaged or truncated"),
        (npz(("x.npy", npy(HEAD % ("'|O'", "(1,)"), bytes(8)))), "holds object, expected numbers"),
        (npz(("x.npy", npy(HEAD % ("'<U2'", "(1,)"), bytes(8)))), "holds <U2, expected numbers"),
        (npz(("x.npy", npy("(" * 5000))), "damaged or truncated"),
        (npz(("x.npy", npy("{'descr': 0L,", version=1))), "damaged or truncated"),
        (npz(("x.npy", npy("'" + "x" * 70_000, version=2))), "damaged or truncated"),
        (npz(("x.npy", b"\x93NUMPY\x09\x00")), "damaged or truncated"),
        (npz(("x.npy", b"")), "damaged or truncated"),
        (npz(("w.npy", b"")), r"unknown arrays \['w'\]"),
        (npz(("x.npy", b""), ("x.npy", b"")), "occurs twice"),
        (npz(("x.npy", bytes(1 << 20)), way=zipfile.ZIP_BZIP2), "expected deflated arrays"),
        (b"PK\x05\x06" + bytes(18), r"arrays \['speed', 'valid', 'x', 'y', 'yaw'\] are missing"),
        (b"", "damaged or truncated"),
    ],
)
def test_arrays_that_are_none_are_refused(case, data, words):
    (case / "tracks.npz").write_bytes(data)
    assert_refused(case, words)


def test_a_header_that_python_would_warn_of_is_one_line(case):
    (case / "tracks.npz").write_bytes(npz(("x.npy", npy("{'descr': 1or 2, 'shape': (0x1for x in y)}"))))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert_refused(case, "damaged or truncated")
    assert not said


@pytest.mark.parametrize("name", ["scenario.json", "tracks.npz", "log.npz"])
def test_a_named_pipe_is_refused_and_not_waited_for(case, name):
    (case / name).unlink()
    os.mkfifo(case / name)
    assert_refused(case, f"{name} is a named pipe, expected a file")


def test_a_map_and_a_manifest_that_are_named_pipes(case):
    (path,) = (case.parent / "maps").iterdir()
    path.unlink()
    os.mkfifo(path)
    assert_refused(case, "road.json.gz is a named pipe")
    os.mkfifo(case.parent / "suite.json")
    with pytest.raises(CaseError, match=r"suite\.json is a named pipe"):
        load_manifest(case.parent)


def test_a_map_that_expands_is_refused(case, monkeypatch):
    monkeypatch.setattr("regents_cosim.cases.map_files._ROAD_BYTES", 1 << 20)
    replace_map(case, lambda entry: msgspec.json.encode(entry) + b" " * (32 << 20))
    with pytest.raises(CaseError, match="gzip data holds more than 1 MiB"):
        load_case(case)


@pytest.mark.parametrize("name", ["lanes", "text"])
def test_a_small_map_holds_little(case, name):
    bomb = b'{"lanes":[' + b"[0,0]," * 4_000_000 if name == "lanes" else b" " * (20 << 20)
    replace_map(case, lambda _: bomb)
    with pytest.raises(CaseError, match="gzip data holds more than 1[67].* MiB"):
        load_case(case)


def test_a_network_that_expands_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("regents_cosim.maps.net_elements._MOST_BYTES", 1 << 20)
    road = replace(platoon().road, sumo_net=gzip.compress(bytes(32 << 20)))
    assert_refused(save_unlisted(replace(platoon(), road=road), tmp_path), "gzip data holds more than 1 MiB")


@pytest.mark.parametrize("text", [b'{"schema": 1, "more": ' + b"[" * 10**7, b"[" * 10**7, b'{"a":' * 10**6])
@pytest.mark.parametrize("name", ["scenario.json", "suite.json"])
def test_json_of_great_depth_is_refused(case, name, text):
    path = case / name if name == "scenario.json" else case.parent / name
    path.write_bytes(text)
    with pytest.raises(CaseError, match="damaged or truncated"):
        load_suite(case if name == "scenario.json" else case.parent)


@pytest.mark.parametrize("gentlest", [5, "careful", [1]])
def test_a_former_verdict_of_another_form_is_refused(tmp_path, gentlest):
    path = save_unlisted(judged(), tmp_path) / "scenario.json"
    content = msgspec.json.decode(path.read_bytes())
    content["judgement"]["avoidability"] = {"gentlest": gentlest}
    path.write_bytes(msgspec.json.encode(content))
    assert_refused(path.parent, "content hash")


# --- numbers ----------------------------------------------------------------------------------


def moved(scenario, **changes):
    """The scenario with one entry of each of these arrays changed, of its second agent at its third step."""
    tracks = scenario.tracks
    for name, value in changes.items():
        array = getattr(tracks, name).copy()
        array[1, 2] = value
        tracks = replace(tracks, **{name: array})
    return replace(scenario, tracks=tracks)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda one: moved(one, x=1e8), r"x is 1e\+08 at agent 1, step 2, expected at most 2.1e\+07 from 0"),
        (lambda one: moved(one, y=-2e5), "spread over 200 km in y, expected at most 100 km"),
        (lambda one: moved(one, speed=1e300), r"speed is 1e\+300 at agent 1"),
        (lambda one: moved(one, yaw=1e9), r"yaw is 1e\+09"),
        (lambda one: replace(one, dt=1e-320), "dt is 1e-320 s, expected 0.0001 to 100"),
        (lambda one: replace(one, target=(0.0, 1e300)), r"target \(0.0, 1e\+300\) is further"),
        (lambda one: replace(one.agents[0], length=1e9), "length 1000000000.0 m, expected a positive number, at most"),
        (lambda one: replace(one.road.lanes[0], centre=np.array([[0, 0], [1e9, 0]])), "lane0: a point is further"),
        (lambda one: replace(one.road, drivable=shapely.box(0, 0, 1, 1e300)), "drivable area reaches further"),
    ],
)
def test_numbers_that_no_scene_on_earth_has(change, words):
    with pytest.raises(ScenarioError, match=words):
        change(platoon())


def test_coordinates_of_any_plane_in_use(tmp_path):
    one = platoon()
    utm = replace(one, tracks=replace(one.tracks, x=one.tracks.x + 5e5, y=one.tracks.y + 9.9e6), target=(5e5, 9.9e6))
    assert load_case(save_unlisted(utm, tmp_path)).target == (5e5, 9.9e6)


wild = st.one_of(st.sampled_from([0.0, 1e-9, -1e-9, 5e4, -5e4]), st.floats(-5e4, 5e4), st.floats(-10, 10))


@pytest.mark.slow
@settings(deadline=None, max_examples=100)
@given(arrays(float, (4, 2, 6), elements=wild), arrays(bool, (2, 6)), st.sampled_from([1e-4, 0.1, 100.0]))
def test_who_is_on_whose_way_in_tracks_that_no_car_drives(numbers, there, dt):
    x, y, yaw, speed = numbers
    there[:, :2] = True
    ego, other = (Agent(name, "car", size, 0.5 * size) for name, size in (("a", 2e3), ("b", 1e-9)))
    tracks = Tracks(x, y, yaw, np.abs(speed), there)
    ways = FrontPath(ego, tracks, 0, dt), FrontPath(other, tracks, 1, dt)
    for one, two in (ways, ways[::-1]):
        list(followings(one, two))
        crossing(one, two)
        joining(one, two)


# --- anything ---------------------------------------------------------------------------------

changes = st.lists(
    st.tuples(st.sampled_from(["flip", "cut", "insert", "repeat"]), st.floats(0, 1), st.binary(min_size=1, max_size=9)),
    min_size=1,
    max_size=4,
)
NUMBERS = [b"-1", b"0", b"1e308", b"1e999", b"NaN", b"null", b"true", b'""', b"[]", b"{}", b"9" * 20, b"1e-320"]


def spoilt(data, how):
    for kind, where, piece in how:
        at = int(where * len(data))
        if kind == "flip":
            data = data[:at] + piece + data[at + len(piece) :]
        elif kind == "cut":
            data = data[:at]
        else:
            data = data[:at] + (piece if kind == "insert" else data[at : at + 40] * 2) + data[at:]
    return data


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("suite")
    SuiteWriter(folder, 0).add(judged())
    return folder


def test_a_key_that_is_gone_is_unset_or_refused(whole):
    (path,) = whole.glob("*/scenario.json")
    before = path.read_bytes()
    try:
        for key in sorted(set(re.findall(rb'"(\w+)":', before))):
            path.write_bytes(before.replace(b'"%s":' % key, b'"%sx":' % key))
            with suppress(CaseError):
                load_suite(whole)
    finally:
        path.write_bytes(before)


FILES = ["suite.json", "*/scenario.json", "*/tracks.npz", "*/log.npz", "*/evasion.npz", "maps/*"]
few_and_many = pytest.mark.parametrize("examples", [60, pytest.param(800, marks=pytest.mark.slow)])


@few_and_many
@pytest.mark.parametrize("name", FILES)
def test_whatever_happened_to_a_file_it_is_read_or_refused(whole, name, examples):
    (path,) = whole.glob(name)
    before = path.read_bytes()
    unpacked = gzip.decompress(before) if name == "maps/*" else None

    @settings(max_examples=examples, deadline=None)
    @given(changes, st.booleans(), st.sampled_from(NUMBERS), st.floats(0, 1))
    def tried(how, by_value, number, where):
        if by_value and path.suffix in (".json", ".gz"):
            text = unpacked or before
            at = text.find(b":", int(where * len(text))) + 1
            end = min(i for i in (text.find(b",", at), text.find(b"}", at), len(text)) if i >= 0)
            text = text[:at] + number + text[end:]
            path.write_bytes(gzip.compress(text) if unpacked else text)
        else:
            path.write_bytes(gzip.compress(spoilt(unpacked, how)) if unpacked and by_value else spoilt(before, how))
        with suppress(CaseError):
            load_suite(whole)

    try:
        tried()
    finally:
        path.write_bytes(before)


@pytest.mark.slow
@few_and_many
def test_whatever_a_file_of_arrays_holds(tmp_path, examples):
    path = tmp_path / "tracks.npz"

    @settings(max_examples=examples, deadline=None)
    @given(st.text(max_size=60), st.binary(max_size=40), st.sampled_from([1, 2, 3]))
    def tried(header, data, version):
        path.write_bytes(npz(("x.npy", npy(header.encode("latin1", "replace").decode("latin1"), data, version))))
        with pytest.raises(InputError):
            load_arrays(path, {"x"})

    tried()


def test_a_sound_file_is_read_where_python_fails_once_to_parse_its_header(tmp_path, monkeypatch):
    read, failures = np.lib.format.read_array_header_1_0, [SystemError("AST constructor recursion depth mismatch")]

    def fails_once(file):
        if failures:
            file.read(4)
            raise failures.pop()
        return read(file)

    np.savez_compressed(tmp_path / "few.npz", x=np.arange(3.0))
    monkeypatch.setattr(np.lib.format, "read_array_header_1_0", fails_once)
    assert load_arrays(tmp_path / "few.npz", ["x"])["x"].tolist() == [0.0, 1.0, 2.0]
    assert not failures
