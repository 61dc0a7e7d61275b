import gzip
import json
import os
import pickle
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import platoon, scene

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.cases.json_files import with_new_keys
from regents_cosim.cases.manifest import find_cases, load_manifest
from regents_cosim.cases.suite import load_suite
from regents_cosim.errors import CaseError, RegentsError
from regents_cosim.saving import SuiteWriter, save_unlisted
from regents_cosim.scenario.attack_record import AttackRecord, Collision
from regents_cosim.scenario.judgement import Fault, Judgement, ReferenceDrive
from regents_cosim.scenario.scenario import Overlap, Signal, Tracks


def attacked():
    recorded = platoon()
    bent = replace(
        recorded.tracks,
        y=recorded.tracks.y + 0.25,
        accel=np.full((9, 80), 0.1),
        curvature=np.full((9, 80), -0.01),
    )
    record = AttackRecord(
        "platoon0",
        "regents",
        "idm",
        "collision",
        17,
        Collision("car03", 42, 4.2, "side_swipe", 3.25, attributed=True),
        ("car03", "car05"),
        {"learning_rate": 1e-3, "exclude_rear": True},
        {"ego": (3.0, 2.0), "pair": (-1.25, -1.0), "road": (0.0, 0.1)},
    )
    return replace(
        recorded,
        tracks=bent,
        log=recorded.tracks,
        attack=record,
        signals=(Signal("tls", ((0, "rG"), (12, "Gr"))),),
        overlaps=(Overlap(("car01", "car02"), 3, 9),),
    )


def judged():
    case = attacked()
    ego = [getattr(case.tracks, name)[:1] for name in ("x", "y", "yaw", "speed", "valid")]
    fault = Fault("adversary", "unsafe_cut_in", "cut in 3.1 m ahead, 7.4 m were safe")
    drives = (ReferenceDrive("careful", True, 0.4, 1.5, 0.9, ("car05",)), ReferenceDrive("rss", False))
    return replace(case, judgement=Judgement((), fault, drivers=drives), evasion=Tracks(*ego))


def assert_equal(a, b):
    for name in ("id", "dt", "agents", "target", "provenance", "signals", "overlaps", "attack", "judgement"):
        assert getattr(a, name) == getattr(b, name)
    for mine, theirs in ((a.tracks, b.tracks), (a.log, b.log), (a.evasion, b.evasion)):
        assert (mine is None) == (theirs is None)
        for item in fields(mine) if mine else ():
            left, right = getattr(mine, item.name), getattr(theirs, item.name)
            assert (left is None and right is None) or np.array_equal(left, right)
    assert a.road.connections == b.road.connections
    assert a.road.drivable.equals_exact(b.road.drivable, 0.0)
    for mine, theirs in zip(a.road.lanes, b.road.lanes, strict=True):
        assert np.array_equal(mine.centre, theirs.centre)
        assert np.array_equal(mine.height, theirs.height)


def raised():
    """A scenario with heights, up a slope and over a bridge."""
    case = platoon()
    lanes = tuple(replace(lane, height=np.array([0.0, 8.0])) for lane in case.road.lanes)
    z = np.interp(case.tracks.x, [-200.0, 600.0], [0.0, 8.0])
    return replace(case, road=replace(case.road, lanes=lanes), tracks=replace(case.tracks, z=z))


@pytest.mark.parametrize("make", [platoon, attacked, judged, raised])
def test_what_is_saved_is_loaded_exactly(tmp_path, make):
    assert_equal(load_case(save_unlisted(make(), tmp_path)), make())


@pytest.mark.parametrize("make", [platoon, attacked, judged, raised])
def test_what_travels_to_another_process_arrives_exactly_and_shares_its_map(make):
    one, other = (pickle.loads(pickle.dumps(make())) for _ in range(2))
    assert_equal(one, make())
    assert one.road is other.road
    assert content_hash(one) == content_hash(make())


@settings(deadline=None, max_examples=20)
@given(st.lists(st.floats(-5e4, 5e4, allow_subnormal=True), min_size=3, max_size=3), st.floats(1e-3, 1.0))
def test_every_number_survives_to_the_last_bit(tmp_path_factory, y, dt):
    made = scene(*((20.0 * i, value, 10.0) for i, value in enumerate(y)), dt=dt)
    assert_equal(load_case(save_unlisted(made, tmp_path_factory.mktemp("suite"))), made)


def test_equal_content_has_an_equal_hash_wherever_it_comes_from():
    other = replace(platoon(), provenance=replace(platoon().provenance, command="somewhere else"))
    assert content_hash(platoon()) == content_hash(other)
    moved = replace(platoon(), tracks=replace(platoon().tracks, x=np.nextafter(platoon().tracks.x, np.inf)))
    assert content_hash(platoon()) != content_hash(moved)


def test_files_are_the_same_bytes_every_time(tmp_path):
    first, second = (save_unlisted(attacked(), tmp_path / name) for name in ("a", "b"))
    for path in sorted(first.iterdir()):
        assert path.read_bytes() == (second / path.name).read_bytes()


def test_a_flat_case_is_written_as_before_there_were_heights(tmp_path):
    flat = save_unlisted(platoon(), tmp_path / "flat")
    assert json.loads((flat / "scenario.json").read_text())["schema"] == 1
    with np.load(flat / "tracks.npz") as packed:
        assert packed.files == ["x", "y", "yaw", "speed", "valid"]
    plain = gzip.decompress(next((tmp_path / "flat" / "maps").glob("*.road.json.gz")).read_bytes())
    assert "heights" not in json.loads(plain)
    assert json.loads((save_unlisted(raised(), tmp_path / "raised") / "scenario.json").read_text())["schema"] == 2
    assert json.loads((save_unlisted(attacked(), tmp_path / "attacked") / "scenario.json").read_text())["schema"] == 3
    assert content_hash(raised()) != content_hash(replace(raised(), tracks=platoon().tracks))


def test_a_map_is_stored_once_per_suite(tmp_path):
    for seed in range(3):
        save_unlisted(platoon(seed=seed), tmp_path)
    assert len(list((tmp_path / "maps").iterdir())) == 1
    assert load_case(tmp_path / "platoon0").road is load_case(tmp_path / "platoon1").road


def test_a_map_is_shared_among_suites_however_many_others_are_loaded_in_between(tmp_path):
    made = platoon()
    suites = []
    for limit in range(20, 44):  # more maps than are kept for themselves
        lanes = tuple(replace(lane, speed_limit=float(limit)) for lane in made.road.lanes)
        suites.append(save_unlisted(replace(made, road=replace(made.road, lanes=lanes)), tmp_path / str(limit)))
    first, again = ([load_case(folder).road for folder in suites] for _ in range(2))
    assert all(one is other for one, other in zip(first, again, strict=True))
    assert len({id(road) for road in first}) == len(suites)


def test_saving_again_replaces_the_case_and_leaves_nothing_else(tmp_path):
    save_unlisted(platoon(), tmp_path)
    save_unlisted(replace(platoon(), target=(1.0, 2.0)), tmp_path)
    assert load_case(tmp_path / "platoon0").target == (1.0, 2.0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["maps", "platoon0"]


def test_a_write_that_fails_leaves_the_old_case(tmp_path, monkeypatch):
    save_unlisted(platoon(), tmp_path)
    monkeypatch.setattr("regents_cosim.cases.files.pack_tracks", lambda tracks: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        save_unlisted(replace(platoon(), target=(1.0, 2.0)), tmp_path)
    assert load_case(tmp_path / "platoon0").target == platoon().target
    assert sorted(path.name for path in tmp_path.iterdir()) == ["maps", "platoon0"]


def test_an_output_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RegentsError, match="cannot write to .*file"):
        save_unlisted(platoon(), tmp_path / "file")


def test_a_log_by_its_former_name_is_read_and_written_by_the_new_one(tmp_path):
    case = save_unlisted(attacked(), tmp_path)
    (case / "log.npz").rename(case / "original.npz")
    assert_equal(load_case(case), attacked())
    assert_equal(load_case(save_unlisted(attacked(), tmp_path)), attacked())
    assert (case / "log.npz").exists()
    assert not (case / "original.npz").exists()


def test_a_collision_type_by_its_former_key_is_read(tmp_path):
    file = save_unlisted(attacked(), tmp_path) / "scenario.json"
    text = file.read_text()
    assert text.count('"collision_type"') == 1
    file.write_text(text.replace('"collision_type"', '"kind"'))
    assert_equal(load_case(file.parent), attacked())


def test_the_kind_of_a_road_user_and_words_keep_their_key():
    said = rb'{"kind":"car","name":"\"kind\":\"t_bone\"","of":{"kind": "t_bone"}}'
    assert with_new_keys(said) == said.replace(b'"kind": "t_bone"', b'"collision_type": "t_bone"')


# --- damage ------------------------------------------------------------------------------------


@pytest.fixture
def case(tmp_path):
    return save_unlisted(attacked(), tmp_path)


@pytest.mark.parametrize("name", ["scenario.json", "tracks.npz", "log.npz"])
@pytest.mark.parametrize("keep", [0, 10, 0.5, 0.99])
def test_truncated_files(case, name, keep):
    whole = (case / name).read_bytes()
    (case / name).write_bytes(whole[: int(keep * len(whole)) if keep < 1 else keep])
    with pytest.raises(CaseError):
        load_case(case)


@pytest.mark.parametrize("name", ["scenario.json", "tracks.npz", "log.npz"])
def test_missing_files(case, name):
    (case / name).unlink()
    with pytest.raises(CaseError):
        load_case(case)


def edit(case, change):
    header = json.loads((case / "scenario.json").read_text())
    change(header)
    (case / "scenario.json").write_text(json.dumps(header))


def rewrite(case, **changes):
    with np.load(case / "tracks.npz") as packed:
        arrays = dict(packed)
    np.savez(case / "tracks.npz", **(arrays | changes))
    return arrays


def test_a_newer_schema(case):
    edit(case, lambda header: header.update(schema=99))
    with pytest.raises(CaseError, match=r"schema 99, this version reads up to 3 \(upgrade"):
        load_case(case)


def test_a_wrong_type_says_where(case):
    edit(case, lambda header: header["agents"][2].update(length="long"))
    with pytest.raises(CaseError, match=r"Expected `float`, got `str` - at `\$.agents\[2\].length`"):
        load_case(case)


def test_a_change_behind_our_back(case):
    edit(case, lambda header: header.update(target=[0.0, 1.0]))
    with pytest.raises(CaseError, match="content hash"):
        load_case(case)


def test_numbers_that_are_not_finite(case):
    speed = np.full((9, 81), np.nan)
    rewrite(case, speed=speed)
    with pytest.raises(CaseError, match="speed is not finite at agent 0, step 0"):
        load_case(case)


def test_arrays_that_do_not_match(case):
    rewrite(case, yaw=np.zeros((9, 80)))
    with pytest.raises(CaseError, match=r"yaw has shape \[9, 80\], expected \[9, 81\]"):
        load_case(case)


class Exploit:
    def __reduce__(self):
        return (os.system, ("touch pwned",))


def test_nothing_is_unpickled(case):
    rewrite(case, x=np.array([Exploit()], dtype=object))
    with pytest.raises(CaseError):
        load_case(case)


@pytest.mark.parametrize("name", ["../../secret", "/etc/passwd", "nothing.road.json.gz"])
def test_maps_are_only_looked_for_beside_the_case(case, name):
    edit(case, lambda header: header["map"].update(road=name))
    with pytest.raises(CaseError, match="map"):
        load_case(case)


def test_a_damaged_map(case):
    path = next((case.parent / "maps").iterdir())
    path.write_bytes(gzip.compress(b'{"lanes": 7}'))
    with pytest.raises(CaseError):
        load_case(case)


# --- suites ------------------------------------------------------------------------------------


def test_a_suite_lists_its_cases_and_keeps_those_it_had(tmp_path):
    first = SuiteWriter(tmp_path, seed=3)
    first.add(platoon(seed=1))
    SuiteWriter(tmp_path, seed=3).add(platoon(seed=0))
    assert [entry.case for entry in load_manifest(tmp_path).cases] == ["platoon0", "platoon1"]
    assert [case.id for case in load_suite(tmp_path)] == ["platoon0", "platoon1"]
    assert find_cases(tmp_path / "platoon1") == [tmp_path / "platoon1"]
    assert load_manifest(tmp_path).seed == 3


def test_a_suite_that_lists_a_case_twice(tmp_path):
    SuiteWriter(tmp_path, seed=3).add(platoon(seed=1))
    manifest = json.loads((tmp_path / "suite.json").read_text())
    manifest["cases"] *= 2
    (tmp_path / "suite.json").write_text(json.dumps(manifest))
    with pytest.raises(CaseError, match="lists case .* 2 times, expected once"):
        load_manifest(tmp_path)


def test_a_damaged_manifest_is_named_itself(tmp_path):
    SuiteWriter(tmp_path, seed=3).add(platoon(seed=1))
    text = (tmp_path / "suite.json").read_text()
    (tmp_path / "suite.json").write_text(text.replace('"seed": 3', '"seed": "3"'))
    with pytest.raises(CaseError, match=r"suite.json: damaged or truncated \(Expected `int`, got `str`"):
        load_manifest(tmp_path)


def test_a_folder_without_a_manifest(tmp_path):
    with pytest.raises(CaseError, match="no suite.json"):
        find_cases(tmp_path)
    with pytest.raises(CaseError, match="not a folder"):
        find_cases(tmp_path / "nowhere")
