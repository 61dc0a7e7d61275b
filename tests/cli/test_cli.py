"""The command line as people and CI use it: in processes of its own."""

import json
import os
import re
import shutil
from dataclasses import asdict
from importlib.metadata import version

import log_files
import pytest
from command import regents
from PIL import Image
from scenes import TIME, moved, scene
from scenes import crash as crashed

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.cases.shipped import network_config
from regents_cosim.saving import save_unlisted
from regents_cosim.scenario.collisions import first_contact

GRID = network_config("grid")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded") / "cases"
    done = regents("record", "-c", GRID, "--count", 3, "--seed", 2, "-o", folder, "--json", code=0)
    return folder, json.loads(done.stdout)


@pytest.fixture(scope="module")
def attacked(recorded, tmp_path_factory):
    """The first case that the attack makes crash: which one that is depends on the version of SUMO."""
    folder, rows = recorded
    for row in rows:
        suite = tmp_path_factory.mktemp("attacked") / "suite"
        done = regents("attack", folder / row["case"], "--attempts", 1, "-o", suite, "--json", code=0)
        found = json.loads(done.stdout)
        if any(one["outcome"] == "collision" for one in found):
            return suite, found
    pytest.fail("the attack finds no crash in any of the windows")


def crash(attacked):
    """Folder and row of a case that ended in a collision."""
    folder, rows = attacked
    row = next(row for row in rows if row["outcome"] == "collision")
    return folder / row["case"], row


def test_record_writes_the_cases_that_its_table_lists(recorded):
    folder, rows = recorded
    assert [entry.case for entry in load_manifest(folder).cases] == sorted(row["case"] for row in rows)
    for row in rows:
        case = load_case(folder / row["case"])
        assert (len(case.agents), case.tracks.steps) == (row["agents"], 81)
        assert case.provenance.command.startswith("regents record -c")
        assert case.provenance.seed == 2


@pytest.mark.slow
def test_the_same_seed_gives_the_same_cases(recorded, tmp_path):
    again = tmp_path / "again"
    regents("record", "-c", GRID, "--count", 3, "--seed", 2, "-o", again)
    assert load_manifest(again).cases == load_manifest(recorded[0]).cases


def test_attack_finds_crashes_that_sumo_confirms(attacked):
    folder, rows = attacked
    crashes = [row for row in rows if row["outcome"] == "collision"]
    assert crashes
    for row in crashes:
        assert row["SUMO_verified"] is True
        case = load_case(folder / row["case"])
        agent, step = first_contact(case.agents, case.tracks)
        assert (case.agents[agent].id, step) == (row["adversary"], row["collision_step"])
        held = {f"holds_{how}": holds for how, holds in asdict(case.judgement.holds).items()}
        assert held.items() <= row.items()
        assert None not in held.values()


def test_every_attacked_case_has_its_picture(attacked):
    folder, rows = attacked
    for row in rows:
        with Image.open(folder / row["case"] / "still.png") as picture:
            assert picture.size == (1200, 800)


@pytest.mark.slow
def test_a_suite_replays_elsewhere(attacked, tmp_path):
    moved = shutil.copytree(attacked[0], tmp_path / "moved")
    done = regents("replay", moved, "--json", cwd=tmp_path, code=0)
    assert all(row["verified"] and row["position_error_mm"] < 1e-3 for row in json.loads(done.stdout))


@pytest.mark.slow
@pytest.mark.parametrize("where", ["sumo", "mirror"])
def test_the_planner_crashes_again_in_closed_loop(attacked, where):
    folder, row = crash(attacked)
    done = regents("replay", folder, "--in", where, "--ego", "planner", "--json")
    (again,) = json.loads(done.stdout)
    assert done.returncode == 0, done.stderr
    assert again["found"] == f"{row['adversary']} at step {row['collision_step']}"


@pytest.mark.slow
@pytest.mark.parametrize("same", [True, False])
def test_another_planner_may_get_away(tmp_path, same):
    """The ego of the case gains speed and runs into the car ahead; constant velocity does not."""
    made = scene((0, 0, 10), (30, 0, 10))
    case = crashed(made, moved(made, 0, x=10 * TIME + 1.5 * TIME**2, speed=10 + 3.0 * TIME))
    hit = case.collision
    drive = ["--ego", "track"] if same else ["--planner", "constant_velocity"]
    done = regents("replay", save_unlisted(case, tmp_path), "--in", "mirror", *drive, "--json")
    (row,) = json.loads(done.stdout)
    assert (done.returncode, row["verified"]) == ((0, True) if same else (1, False))
    assert row["expected"] == f"{hit.agent} at step {hit.step}"
    assert row["found"] == (row["expected"] if same else None)


@pytest.mark.slow
def test_the_careful_driver_can_be_watched_avoiding_a_crash(attacked, recorded, tmp_path):
    folder, rows = attacked
    assert all((row["prevention"] is None) == (row["outcome"] != "collision") == (row["clean"] is None) for row in rows)
    row = next(row for row in rows if row["prevention"] == "preventable")
    assert load_case(folder / row["case"]).evasion is not None
    picture = tmp_path / "evasion.png"
    done = regents("replay", folder / row["case"], "--ego", "evasion", "--record", picture, "--json")
    (again,) = json.loads(done.stdout)
    assert done.returncode == 0, done.stderr
    assert (again["verified"], again["expected"], again["found"]) == (True, None, None)
    assert picture.is_file()
    done = regents("replay", recorded[0], "--ego", "evasion", code=2)
    assert "has no evasion" in done.stderr


@pytest.mark.slow
def test_recording_a_film(attacked, tmp_path):
    folder, row = crash(attacked)
    assert regents("replay", folder, "--in", "mirror", "--record", tmp_path / "out.gif").returncode == 0
    with Image.open(tmp_path / "out.gif") as film:
        assert film.n_frames >= min(row["collision_step"] + 10, 80)


@pytest.mark.slow
def test_attack_straight_from_traffic(tmp_path):
    few = "iterations = 2\nverify = false\njudge = false\npictures = false\n"
    (tmp_path / "few.toml").write_text(few)
    words = ("attack", "-c", GRID, "--count", 1, "--config", tmp_path / "few.toml", "--quiet")
    done = regents(*words, "-o", tmp_path / "suite", "--method", "king", "--planner", "log_replay")
    assert (done.returncode, done.stderr) == (0, "")
    (entry,) = load_manifest(tmp_path / "suite").cases
    attack = load_case(tmp_path / "suite" / entry.case).attack
    assert attack.method == "king"
    assert entry.case == f"{attack.case}-king-log_replay"
    assert "king against log_replay" in done.stdout


@pytest.mark.slow
def test_what_follows_two_dashes_goes_to_sumo(tmp_path):
    done = regents("record", "-c", GRID, "--count", 1, "-o", tmp_path / "a", "--", "--scale", "0", code=2)
    assert "no vehicle was on the road" in done.stderr


@pytest.mark.slow
def test_the_compilation_cache(recorded, tmp_path):
    words = ("evaluate", recorded[0] / recorded[1][0]["case"], "--planner", "constant_velocity")
    first, second = (regents(*words, "--json", REGENTS_CACHE=str(tmp_path / "kept")) for _ in range(2))
    assert any((tmp_path / "kept" / "compiled").rglob("*drive*"))
    assert (first.returncode, first.stdout) == (second.returncode, second.stdout)


@pytest.mark.slow
def test_data_goes_to_stdout_and_talk_to_stderr(recorded, tmp_path):
    done = regents("record", "-c", GRID, "--count", 500, "--end", 40, "-o", tmp_path / "many", "--json")
    assert len(json.loads(done.stdout)) < 500
    assert "of the 500 windows asked for" in done.stderr
    assert re.search(
        r"can lawfully cross or join the ego's path: (none|\d+) of \d+; in (none|\d+) of them with the right of way$",
        done.stderr,
        re.MULTILINE,
    )


def test_version():
    assert regents("--version").stdout.strip() == version("regents_cosim")


# --- bad input ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    """A folder of broken inputs."""
    folder = tmp_path_factory.mktemp("broken")
    net = GRID.with_name("grid.net.xml")
    (folder / "broken.sumocfg").write_text("<configuration><input><net-file value='x")
    (folder / "no_net.sumocfg").write_text("<configuration><time><end value='60'/></time></configuration>")
    (folder / "no_traffic.sumocfg").write_text(f"<configuration><net-file value='{net}'/></configuration>")
    (folder / "refused.sumocfg").write_text(
        f"<configuration><net-file value='{net}'/><route-files value='ghost.rou.xml'/></configuration>"
    )
    trip = "<trip id='a' type='ghost' depart='0' from='A0B0' to='B0C0'/>"
    (folder / "ghost.rou.xml").write_text(f"<routes>{trip}</routes>")
    lane = "<lane id='e_0' index='0' speed='10' length='100' shape='0,0 100,0' allow='rail'/>"
    (folder / "rail.net.xml").write_text(
        "<net version='1.20'><location netOffset='0,0' convBoundary='0,0,100,0' origBoundary='0,0,100,0' "
        f"projParameter='!'/><edge id='e' from='a' to='b'>{lane}</edge>"
        "<junction id='a' type='dead_end' x='0' y='0' incLanes='' intLanes='' shape='0,0'/>"
        "<junction id='b' type='dead_end' x='100' y='0' incLanes='e_0' intLanes='' shape='100,0'/></net>"
    )
    (folder / "file").write_text("")
    return folder


BAD_TRAFFIC = [
    (("-c", "missing.sumocfg"), "SUMO configuration not found: missing.sumocfg"),
    (("-c", "broken.sumocfg"), "broken or truncated XML"),
    (("-c", "no_net.sumocfg"), "no network named"),
    (("-c", "no_traffic.sumocfg"), "no vehicle was on the road"),
    (("-c", "refused.sumocfg"), "SUMO refused: The vehicle type 'ghost' for vehicle 'a' is not known"),
    (("-n", "rail.net.xml"), "no lane"),
    (("-c", GRID, "--horizon", "700"), "a horizon of 700 s does not fit into the simulation"),
    (("-c", GRID, "--begin", "700"), "SUMO refused: The end time should be after the begin time"),
    (("-c", GRID, "--count", "0"), "--count is 0, expected 1 to 1e+06"),
    (("-c", GRID, "--cout", "1"), "Unknown option: --cout"),
    (("-c", GRID, "--ego-kind", "tram"), "tram"),
    (("-c", GRID, "--executor", "moon"), "expected `local`, `dask` or `dask:ADDRESS`"),
    ((), "no traffic named"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("words", "said"), BAD_TRAFFIC, ids=lambda value: str(value)[:40])
def test_bad_traffic(broken, tmp_path, words, said):
    done = regents("record", *words, "-o", tmp_path / "out", cwd=broken, code=2)
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_an_output_folder_that_cannot_be_written_is_found_before_the_work(broken):
    done = regents("attack", "-c", GRID, "-o", broken / "file")
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert "cannot write to" in done.stderr


@pytest.mark.slow
def test_damaged_cases(recorded, tmp_path):
    suite = shutil.copytree(recorded[0], tmp_path / "suite")
    (suite / recorded[1][0]["case"] / "tracks.npz").write_bytes(b"PK")
    for words in (("attack", suite, "-o", tmp_path / "out"), ("replay", suite)):
        done = regents(*words)
        assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
        assert "damaged or truncated" in done.stderr
    assert not (tmp_path / "out").exists()


def test_missing_system_libraries_are_named(tmp_path):
    hidden = tmp_path / "libsumo"
    hidden.mkdir()
    (hidden / "__init__.py").write_text("raise ImportError('libGL.so.1: cannot open shared object file')")
    info = tmp_path / "libsumo-1.28.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: libsumo\nVersion: 1.28.0\n")
    path = f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    done = regents("record", "-c", GRID, "-o", tmp_path / "out", PYTHONPATH=path)
    assert (done.returncode, len(done.stderr.splitlines())) == (3, 1)
    assert "libGL.so.1" in done.stderr
    assert "apt-get install libgl1 libx11-6 libxext6 libxrender1 libatomic1 libexpat1" in done.stderr


# --- logged traffic -------------------------------------------------------------------------------


@pytest.mark.slow
def test_logs_are_recorded_inspected_and_attacked(tmp_path):
    log = log_files.write_gpudrive(tmp_path)
    done = regents("record", "--log", log, "--horizon", 4, "-o", tmp_path / "cases", "--json", code=0)
    assert [row["ego"] for row in json.loads(done.stdout)] == ["11", "11"]
    assert "headings in radians" in done.stderr
    done = regents("inspect", log, "-o", tmp_path / "pictures", "--json")
    (row,) = json.loads(done.stdout)
    assert (row["format"], row["agents"], row["ego"]) == ("gpudrive", 4, "11")
    with Image.open(tmp_path / "pictures" / "abc.png") as picture:
        assert picture.size == (1200, 900)
    words = ("--method", "regents", "--iterations", 2, "--no-pictures", "--json")
    done = regents("attack", tmp_path / "cases", *words, "-o", tmp_path / "suite", code=0)
    assert {row["SUMO_verified"] for row in json.loads(done.stdout)} == {None}


@pytest.mark.slow
def test_a_log_that_cannot_be_read_is_one_line(tmp_path):
    (tmp_path / "a.bin").write_bytes(b"nothing")
    for words in (("record", "--log", tmp_path / "a.bin", "-o", tmp_path / "out"), ("inspect", tmp_path / "a.bin")):
        done = regents(*words)
        assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
        assert "not a log that is known" in done.stderr
    assert not (tmp_path / "out").exists()
