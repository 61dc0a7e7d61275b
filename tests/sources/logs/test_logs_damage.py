"""Damaged, mislabelled and hostile logs: one clear error each, at once, and nothing runs."""

import contextlib
import gzip
import json
import os
import pickle
import random
import re
import struct
import warnings
from collections import Counter
from pathlib import Path

import log_files
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from params import slow

from regents_cosim.errors import LogError, RegentsError
from regents_cosim.sources.logs.cut import LogWindows, cut
from regents_cosim.sources.logs.files.unpickle import unpickle
from regents_cosim.sources.logs.formats import CompanionFiles, find_logs, format_of, formats, read_log, unpacked
from regents_cosim.sources.logs.inspection import inspect_scene
from regents_cosim.sources.logs.readers import OWN
from regents_cosim.sources.logs.record import record_log, scenes_of
from regents_cosim.sources.logs.roads.argoverse2_map import read_map
from regents_cosim.sources.windows import RecordingOrigin

# What ten minutes of mutated logs per reader have found, reduced to what it takes.
CORPUS = sorted((Path(__file__).parent / "damaged_logs").iterdir())
WITH_POLARS = ("argoverse2_motion", "argoverse2_sensor")
FILES = [name for name in log_files.FORMATS if name not in WITH_POLARS]


def use(path, name="auto"):
    """Read everything and cut windows, as `record` does; the error if it is one that a user may see."""
    try:
        for file, one in find_logs(path, name):
            for scene in read_log(file, one, CompanionFiles()):
                for _, _ in zip(
                    range(2), cut(scene, LogWindows(), RecordingOrigin("x", "x", "x"), Counter()), strict=False
                ):
                    pass
    except RegentsError as error:
        return error
    return None


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    return {name: log_files.write(name, tmp_path_factory.mktemp(name)) for name in FILES}


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_what_fuzzing_found(path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        error = use(path)
        with contextlib.suppress(RegentsError):
            for _, name, scene in scenes_of(path):
                inspect_scene(scene, name)
    assert error is None or len(str(error)) < 500, "a message is read by somebody"


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("content", [b"", b"\0" * 4096, b"garbage, not a log\n" * 200, bytes(range(256)) * 16])
def test_nonsense_is_refused_by_every_reader(logs, name, content):
    path = logs[name]
    kept = path.read_bytes()
    try:
        path.write_bytes(content)
        error = use(path, name)
        assert error is not None
        assert path.name in str(error)
    finally:
        path.write_bytes(kept)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("share", [0.01, 0.45, 0.98])
def test_truncated_logs_are_refused_or_shorter(logs, name, share):
    path = logs[name]
    kept = path.read_bytes()
    try:
        path.write_bytes(kept[: int(share * len(kept))])
        error = use(path, name)
        assert isinstance(error, LogError) or path.suffix == ".csv"
    finally:
        path.write_bytes(kept)


def test_nothing_known_says_what_is(tmp_path):
    (tmp_path / "a.bin").write_bytes(b"nothing")
    with pytest.raises(LogError, match=r"not a log that is known; expected Waymo.*CommonRoad"):
        record_log(tmp_path / "a.bin")
    (tmp_path / "b.bin").write_bytes(b"")
    with pytest.raises(LogError, match="the file is empty"):
        record_log(tmp_path / "b.bin")
    with pytest.raises(LogError, match="no log in this folder"):
        record_log(tmp_path)
    with pytest.raises(LogError, match="not found"):
        record_log(tmp_path / "missing")
    (tmp_path / "c.xml").write_text('<fcd-export><timestep time="0"/></fcd-export>')
    with pytest.raises(LogError, match="--fcd"):
        record_log(tmp_path / "c.xml")


MISLABELLED = [("waymo", "gpudrive"), ("gpudrive", "commonroad"), ("scenarionet", "waymo"), ("highd", "levelx"),
               ("ad4che", "levelx"), ("sind", "interaction"),
               ("interaction", "ngsim"), ("commonroad", "scenarionet")]  # fmt: skip


@pytest.mark.parametrize("pair", MISLABELLED)
def test_a_wrong_format_is_refused(logs, pair):
    assert isinstance(use(logs[pair[0]], pair[1]), LogError)


# --- mutations ----------------------------------------------------------------------------------

NUMBERS = (b"nan", b"inf", b"-1", b"0", b"1e308", b"1e9", b"9" * 25, b"", b"0.0000001", b"-99999999")
PIECES = (*NUMBERS, b"\xff" * 4, b"\0" * 8, b"\x7f\xff\xff\xff", b"[", b"{", b'"', b"<", b">", b",", b"\n")


def mutated(content, rng):
    """A few bytes, pieces or numbers changed."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 4))):
        at = rng.randrange(len(data)) if data else 0
        match rng.randrange(6):
            case 0 if data:
                data[at] ^= 1 << rng.randrange(8)
            case 1:
                del data[at : at + rng.choice((1, 4, 64, 1024))]
            case 2:
                data[at:at] = rng.choice(PIECES)
            case 3:
                data[at:at] = data[: rng.choice((4, 64))]
            case 4:
                del data[at:]
            case _:
                found = list(re.finditer(rb"-?\d+\.?\d*", bytes(data[at : at + 200])))
                if found:
                    one = rng.choice(found)
                    data[at + one.start() : at + one.end()] = rng.choice(NUMBERS)
    return bytes(data)


@pytest.mark.parametrize("name", [*FILES, "waymo payload", "gpudrive plain"])
@settings(max_examples=25, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 2**32))
def test_mutations_never_crash_a_reader(logs, name, seed, tmp_path_factory):
    rng = random.Random(seed)
    path = logs[name.split()[0]]
    kept = path.read_bytes()
    if name == "waymo payload":  # damaged inside, with checks that hold
        content = log_files.record(mutated(log_files.waymo_scenario(), rng))
    elif name == "gpudrive plain":
        content = mutated(json.dumps(log_files.gpudrive(rng.randrange(1, 4))).encode(), rng)
    else:
        content = mutated(kept, rng)
    try:
        path.write_bytes(content)
        use(path, name.split()[0])
    finally:
        path.write_bytes(kept)


@pytest.mark.slow
@pytest.mark.parametrize("name", [WITH_POLARS[0], *map(slow, WITH_POLARS[1:])])
def test_damaged_parquet_and_feather(tmp_path, name, capfd):
    pytest.importorskip("polars")
    folder = log_files.write(name, tmp_path)
    file = next(folder.glob("*.parquet"), folder / "annotations.feather")
    content = file.read_bytes()
    for damaged in (content[: len(content) // 2], content[:8] + b"\xff" * 300, content[:-300] + b"\xff" * 300):
        file.write_bytes(damaged)
        assert isinstance(use(folder), LogError)
    assert capfd.readouterr().err == "", "polars' threads say that they panic"


@pytest.mark.parametrize(("part", "number"), [("left_lane_boundary", 99_999_999.0), ("area_boundary", 1e300)])
def test_an_argoverse2_map_to_the_end_of_the_world(tmp_path, part, number):
    log_files.argoverse2_map(tmp_path)
    (file,) = tmp_path.iterdir()
    content = json.loads(file.read_text())
    owner = content["lane_segments" if "lane" in part else "drivable_areas"]
    next(iter(owner.values()))[part][0]["y"] = number
    file.write_text(json.dumps(content))
    with np.errstate(all="ignore"), pytest.raises(LogError, match=r"jumps by|beyond 1e\+08"):  # as `read_log` does
        read_map(tmp_path)


# --- bombs and traps ------------------------------------------------------------------------------


class Hostile:
    """Runs a command when Python unpickles it."""

    def __init__(self, trace):
        self.trace = trace

    def __reduce__(self):
        return os.system, (f"touch {self.trace}",)


@pytest.mark.parametrize("protocol", range(6))
def test_hostile_pickles_run_nothing(tmp_path, protocol):
    trace = tmp_path / "ran"
    for number, content in enumerate((Hostile(trace), {"tracks": {1: Hostile(trace)}}, [eval], np.load)):
        path = tmp_path / f"{number}.pkl"
        path.write_bytes(pickle.dumps(content, protocol=protocol))
        error = use(path, "scenarionet")
        assert isinstance(error, LogError)
        assert "refused" in str(error) or "instruction" in str(error)
    assert not trace.exists()


@pytest.mark.parametrize(
    "content",
    [
        b"\x80\x04" + b"(" * 30_000 + b".",  # marks that never end
        b"\x80\x04)" + b"\x85" * 100_000 + b"K\x01\x86.",  # a deep tuple
        b"\x80\x04}(" + b")" + b"\x85" * 300_000 + b"K\x01u.",  # as a key, whose hash would overflow the stack
        b"\x80\x04]r\xff\xff\xff\x7f.",  # place 2 147 483 647 of the memo
        b"\x80\x04\x8e\xff\xff\xff\xff\xff\xff\xff\x0f.",  # bytes of an absurd length
        b"\x80\x04\x8b\xff\xff\xff\x7f.",
        b"\x80\x02cnumpy\nload\n.",
        b"\x80\x02c_codecs\nencode\nX\x01\x00\x00\x00aX\x05\x00\x00\x00rot13\x86R.",
        b"\x80\x02c_codecs\nencode\nX\x02\x00\x00\x00\xc4\x80X\x06\x00\x00\x00latin1\x86R.",
        b"\x80\x02c__builtin__\nbytes\n\x8a\x05\x00\x00\x00\x00\x7f\x85R.",  # of 2 TB
        b"\x80\x04\x8c\x08builtins\x8c\x04eval\x93\x8c\x011\x85R.",
        b"\x80\x02cnumpy\ndtype\nU\x0299\x85R.",
        b"\x80\x04\x82\x01.",  # an extension
        b"\x80\x05\x8c\x13numpy._core.numeric\x8c\x0b_frombuffer\x93(\x8a\x06\x00\x10\xa5\xd4\xe8\x00"  # 1e12 for bytes
        b"\x8c\x05numpy\x8c\x05dtype\x93\x8c\x02f8\x85RK\x03\x8c\x01CtR.",
        b"\x80\x04N.",
    ],
)
def test_pickles_that_no_log_needs(content, tmp_path):
    (tmp_path / "a.pkl").write_bytes(content)
    assert isinstance(use(tmp_path / "a.pkl", "scenarionet"), LogError)


def test_pickles_of_numpy_read_the_same():
    kept = {
        "a": np.arange(6.0).reshape(2, 3), "b": np.asfortranarray(np.arange(6).reshape(2, 3)), "c": [1, 2.5, "x", None],
        "d": (True, b"y"), "e": np.array([True, False]), "f": np.float32([1, 2]),
        "g": np.float32(2.5), "h": np.bool_(1),
    }  # fmt: skip
    kept["again"] = kept["a"]
    for protocol in (2, 3, 4, 5):
        found = unpickle(pickle.dumps(kept, protocol=protocol))
        for name in "abefgh":
            np.testing.assert_array_equal(found[name], kept[name])
            assert np.asarray(found[name]).dtype.kind == kept[name].dtype.kind
        assert found["again"] is found["a"]
        assert (found["c"], found["d"]) == (kept["c"], kept["d"])
        assert unpickle(pickle.dumps({1}, protocol)) == [1]
        assert unpickle(pickle.dumps(b"", protocol)) == b""


def test_a_file_that_names_one_array_many_times_is_refused(tmp_path):
    scene = log_files.scenarionet()
    line = np.zeros((5000, 3))
    scene["map_features"] = {f"e{i}": {"type": "ROAD_EDGE_BOUNDARY", "polyline": line} for i in range(2000)}
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(scene, protocol=4))
    assert "numbers of one more array" in str(use(tmp_path / "a.pkl"))


@pytest.mark.slow
def test_a_gzip_bomb_is_not_unpacked(tmp_path):
    bomb = tmp_path / "bomb.json.gz"
    bomb.write_bytes(gzip.compress(b'{"objects": [' + b" " * (200 << 20)))
    with pytest.raises(LogError, match="holds more than"):
        unpacked(bomb)
    assert "holds more than" in str(use(bomb))


@pytest.mark.parametrize("name", ["gpudrive", "commonroad", "table"])
def test_deep_nesting_and_long_lines(tmp_path, name):
    content = {
        "gpudrive": b'{"objects": ' + b"[" * 200_000,
        "commonroad": b'<commonRoad commonRoadVersion="2020a" timeStepSize="0.1">' + b"<a>" * 100_000,
        "table": b"id,time,x,y\n" + b"1" * 3_000_000,
    }[name]
    (tmp_path / "deep").write_bytes(content)
    assert isinstance(use(tmp_path / "deep", name), LogError)


def test_a_mapping_with_a_key_of_endless_parts_is_not_parsed(tmp_path):
    path = log_files.write_table(tmp_path)
    (tmp_path / "mine.toml").write_text(".".join(["a"] * 50_000) + " = 1")
    assert "expected a mapping of columns" in str(use(path))


def test_entities_are_refused(tmp_path):
    path = tmp_path / "a.xml"
    path.write_text('<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bb">]><commonRoad>&b;</commonRoad>')
    assert "document type" in str(use(path))


def test_a_record_of_an_absurd_length_is_not_allocated(tmp_path):
    head = struct.pack("<Q", 1 << 60)
    good = log_files.record(b"")[:0] + head + struct.pack("<I", log_files.masked(log_files.crc32c(head)))
    (tmp_path / "a.tfrecord").write_bytes(good + b"x" * 100)
    assert "truncated" in str(use(tmp_path / "a.tfrecord"))


def test_times_far_apart_do_not_make_endless_windows(tmp_path):
    rows = [(1, t, 10.0 * t, 0.0) for t in (0.0, 0.1, 0.2, 5e7, 5e7 + 0.1, 5e7 + 0.2)]
    path = log_files.write_rows(tmp_path / "a.csv", "id,time,x,y", rows)
    assert use(path, "table") is None or isinstance(use(path, "table"), RegentsError)


@pytest.fixture
def entry(monkeypatch):
    """Installs the format of another package."""
    from importlib.metadata import EntryPoint

    from regents_cosim.system import user_code

    def install(value, name="mine"):
        formats.cache_clear()
        point = EntryPoint(name, value, "regents_cosim.sources")
        monkeypatch.setattr(user_code, "entry_points", lambda group: [point])

    yield install
    monkeypatch.undo()
    formats.cache_clear()


def test_a_third_party_reader_that_is_broken_is_named(entry):
    entry("no_such_module:READER")
    with pytest.raises(LogError, match="'mine'"):
        formats()
    entry("regents_cosim.sources.logs.readers.waymo:read")
    with pytest.raises(LogError, match="not a LogFormat"):
        formats()


def test_the_format_of_another_package_comes_before_any_table_and_replaces_none(entry, tmp_path, monkeypatch):
    (tmp_path / "theirs.py").write_text(
        "from regents_cosim.sources.logs.formats import LogFormat\n"
        "FORMAT = LogFormat('x', 'Theirs', lambda path, head: head.startswith(b'id,time,x,y,their_own'), print)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    log = log_files.write_rows(tmp_path / "a.csv", "id,time,x,y,their_own", [(1, 0.1 * i, i, 0, 0) for i in range(9)])
    assert format_of(log).name == "table"
    entry("theirs:FORMAT")
    assert format_of(log).name == "mine", "its name is that of the entry point"
    assert list(formats())[-2:] == ["mine", "table"]
    ours = {one.name: one for one in OWN}
    for name in ("waymo", "table"):
        entry("theirs:FORMAT", name)
        assert formats() == ours
