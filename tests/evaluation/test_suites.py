"""`regents suite`: what is chosen, built, listed, checked and merged."""

import json
import shlex
import shutil
import subprocess
import sys
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import regression_cases
from hypothesis import given
from hypothesis import strategies as st
from places import ROOT
from quick_xla import as_users_have_it
from scenes import platoon, scene
from shipped_cases import QUICKSTART, crash_on

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.cases.provenance import versions
from regents_cosim.cli import run
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.regression.baseline import Baseline, DriveOutcome, load_baseline, save_baseline
from regents_cosim.evaluation.suites.building import Recipe, choose_adversarial, choose_ordinary, follows
from regents_cosim.evaluation.suites.cards import CaseCard, card_of, tagged_card_of
from regents_cosim.evaluation.suites.folders import write_suite
from regents_cosim.geometry.frames import wrap
from regents_cosim.norms.grades import Prevention
from regents_cosim.saving import SuiteWriter

PREVENTABLE = Prevention.PREVENTABLE
TYPES = ("rear_end_by_ego", "rear_end_by_adversary", "side_swipe", "t_bone", "head_on")


def card(number=0, collision_type="t_bone", network="merge", window="w", clean=True, prevention=PREVENTABLE, **rest):
    values = {"adversary": "car1", "planner": "idm", "method": "focused", "hash": "", **rest}
    return CaseCard(f"case{number:03d}", network, collision_type, clean, prevention, window=window, **values)


# Plain values, of which the test makes cards: beartype, which checks them, draws from `random`, and a strategy may not.
values_of_cards = st.lists(
    st.fixed_dictionaries({
        "collision_type": st.sampled_from(TYPES),
        "network": st.sampled_from(["merge", "grid", "crossing"]),
        "window": st.sampled_from([f"w{i}" for i in range(12)]),
        "adversary": st.sampled_from(["car1", "car2"]),
        "clean": st.sampled_from([True, True, False, None]),
        "prevention": st.sampled_from([PREVENTABLE, *Prevention, None]),
        "planner": st.sampled_from(["idm", "log_replay"]),
        "telling": st.sampled_from([False, None]),
    }),
    max_size=40,
)  # fmt: skip


# --- what is chosen ---------------------------------------------------------------------------


@pytest.mark.slow
@given(values_of_cards, st.integers(0, 20), st.integers(0, 5), st.randoms())
def test_the_choice_does_not_depend_on_the_order_and_keeps_the_rules(values, count, not_preventable, random):
    found = [card(i, **of) for i, of in enumerate(values)]
    chosen = choose_adversarial(found, count, not_preventable, seed=0)
    shuffled = random.sample(found, len(found))
    assert choose_adversarial(shuffled, count, not_preventable, seed=0) == chosen
    assert all(one.clean and one.prevention not in (None, Prevention.UNKNOWN) for one in chosen)
    could = [one for one in chosen if one.prevention is not Prevention.NOT_PREVENTABLE]
    assert len(could) <= count
    assert len(chosen) - len(could) <= not_preventable
    assert max(Counter(one.window for one in could).values(), default=0) <= 2
    alike = Counter((one.window, one.adversary, one.collision_type) for one in could)
    assert max(alike.values(), default=0) <= 1
    assert [one.case for one in chosen] == sorted(one.case for one in chosen)


def test_types_and_networks_are_balanced():
    many = [
        card(i, collision_type=one, network=network, window=f"w{i}")
        for i, (one, network) in enumerate(
            [("t_bone", "grid")] * 50
            + [("t_bone", "merge")] * 9
            + [("head_on", "grid")] * 7
            + [("side_swipe", "merge")] * 3
        )
    ]
    chosen = choose_adversarial(many, 15, 0, seed=0)
    assert Counter(one.collision_type for one in chosen) == {"t_bone": 6, "head_on": 6, "side_swipe": 3}
    assert Counter(one.network for one in chosen if one.collision_type == "t_bone") == {"grid": 3, "merge": 3}
    assert choose_adversarial(many, 15, 0, seed=1) != chosen


def test_telling_crashes_are_chosen_before_all_others():
    many = [card(i, collision_type=TYPES[i % 5], window=f"w{i}", telling=(False, None)[i % 2]) for i in range(20)]
    telling = [card(20 + i, collision_type="t_bone", window=f"t{i}", telling=True) for i in range(4)]
    chosen = choose_adversarial([*many, *telling], 8, 0, seed=0)
    assert len(chosen) == 8
    assert all(one in chosen for one in telling)
    assert len({one.collision_type for one in chosen if not one.telling}) == 4  # types that there are none of yet


def test_half_of_the_ordinary_cases_follow_somebody():
    recorded = [
        card(i, collision_type="ordinary", window=f"w{i}", clean=None, prevention=None, adversary=None)
        for i in range(30)
    ]
    followers = {one.case for one in recorded[:6]}
    chosen = choose_ordinary(recorded, followers, 10, seed=0)
    assert sum(one.case in followers for one in chosen) == 5


def test_who_follows():
    assert follows(regression_cases.follows())
    assert not follows(scene((0, 0, 10), (0, 3.2, 10), (-20, 0, 10)))
    assert not follows(scene((0, 0, 10), (60, 0, 10)))


# --- building ---------------------------------------------------------------------------------


def test_a_recipe_asks_for_adversaries_that_there_are():
    assert Recipe(adversary_kinds=("cyclist",)).adversary_kinds == ("cyclist",)
    with pytest.raises(RegentsError, match="expected one or more of vehicle,cyclist,pedestrian, each once"):
        Recipe(adversary_kinds=("cyclist", "cyclist"))


@pytest.mark.slow
def test_a_part_of_quickstart_is_made_again(tmp_path):
    """By its own command and the code of the commit that it names, on one network.

    What SUMO gave is the same bit for bit. What was searched may differ in last bits: compiled programs use the vector
    instructions of the processor, and the suite was made on another one.
    """
    crash, revision = load_case(crash_on("crossing")), load_manifest(QUICKSTART).versions["revision"]
    if crash.provenance.versions != versions():
        pytest.skip(f"made with other packages: {crash.provenance.versions}")
    archive = subprocess.run(
        ["git", "-C", ROOT, "archive", revision, "regents_cosim", "sumo_nets"], capture_output=True, check=False
    )
    if archive.returncode:
        pytest.skip(f"commit {revision} is not here: {archive.stderr.decode()}")
    subprocess.run(["tar", "-x", "-C", tmp_path], input=archive.stdout, check=True)
    words = [*shlex.split(crash.provenance.command)[1:], "-o", "again"]
    program = "from regents_cosim.cli import main; main()"
    environment = as_users_have_it() | {"PYTHONPATH": str(tmp_path)}
    subprocess.run([sys.executable, "-c", program, *words], cwd=tmp_path, env=environment, check=True)
    for case in (crash.id, f"{crash.id}-harmless"):
        again, shipped = load_case(tmp_path / "again" / case), load_case(QUICKSTART / case)
        assert (again.attack and again.attack.outcome) == (shipped.attack and shipped.attack.outcome)
        assert again.agents == shipped.agents
        for name in ("x", "y", "speed", "valid"):
            np.testing.assert_allclose(getattr(again.tracks, name), getattr(shipped.tracks, name), rtol=0.0, atol=1e-3)
        turned = wrap(again.tracks.yaw - shipped.tracks.yaw)  # pi and -pi are one heading
        np.testing.assert_allclose(turned[shipped.tracks.valid], 0.0, atol=1e-3)
        made = tmp_path / "again" / case
        [log] = [made / name for name in ("log.npz", "original.npz") if (made / name).is_file()]  # the former name
        assert log.read_bytes() == (QUICKSTART / case / "log.npz").read_bytes()


def test_a_suite_takes_the_place_of_the_one_before(tmp_path):
    folder = regression_cases.write(tmp_path / "suite")
    save_baseline(
        folder / "baseline.json",
        Baseline().accepting("idm", "mirror", {"follows": DriveOutcome("", "no_collision")}, ["follows"]),
    )
    write_suite(folder, [platoon()], 3)
    assert [entry.case for entry in load_manifest(folder).cases] == ["platoon0"]
    assert sorted(path.name for path in folder.iterdir()) == ["baseline.json", "maps", "platoon0", "suite.json"]
    assert not [path for path in tmp_path.iterdir() if path != folder]
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").write_text("")
    with pytest.raises(RegentsError, match="exists and is not a suite"):
        write_suite(tmp_path / "other", [platoon()], 0)


# --- the commands -----------------------------------------------------------------------------


def regents(capsys, *words):
    code = run(["suite", *map(str, words)])
    shown = capsys.readouterr()
    return code, shown.out, " ".join(shown.err.split())


def test_list(tmp_path, capsys):
    folder = regression_cases.write(tmp_path / "suite")
    code, out, _ = regents(capsys, "list", folder, "--json")
    rows = {row["case"]: row for row in json.loads(out)}
    assert code == 0
    assert [row["collision_type"] for row in rows.values()] == ["ordinary", "side_swipe", "side_swipe"]
    assert rows["pushes"]["adversary"] == "car02"
    assert rows["follows"]["conduct"] is None
    assert tagged_card_of(crash_on("crossing")).conduct == "makes_a_mistake"
    assert rows["pushes"]["hash"] == load_manifest(folder).cases[1].hash == card_of(folder / "pushes").hash


def _truncate_tracks(folder):
    (folder / "follows" / "tracks.npz").write_bytes(b"PK")


def _lose_map(folder):
    for file in (folder / "maps").iterdir():
        file.unlink()


def _another_content(folder):
    SuiteWriter(folder.parent / "other", 0).add(replace(regression_cases.follows(), target=(1.0, 2.0)))
    shutil.rmtree(folder / "follows")
    shutil.copytree(folder.parent / "other" / "follows", folder / "follows")


def _forget_a_case(folder):
    suite = load_manifest(folder)
    text = (folder / "suite.json").read_text()
    assert suite.cases[0].case == "follows"
    manifest = json.loads(text)
    manifest["cases"] = manifest["cases"][1:]
    (folder / "suite.json").write_text(json.dumps(manifest))


def _two_names(folder):
    (folder / "follows").rename(folder / "other")
    manifest = (folder / "suite.json").read_text()
    (folder / "suite.json").write_text(manifest.replace('"case": "follows"', '"case": "other"'))


def _stale_baseline(folder):
    entries = {"follows": DriveOutcome("0" * 64, "no_collision")}
    save_baseline(folder / "baseline.json", Baseline().accepting("idm", "mirror", entries, entries))


def _baseline_of_nothing(folder):
    entries = {"follows2": DriveOutcome("0" * 64, "no_collision")}
    save_baseline(folder / "baseline.json", Baseline().accepting("idm", "mirror", entries, entries))


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_truncate_tracks, "tracks.npz: damaged or truncated"),
        (_lose_map, "road.json.gz not found"),
        (_another_content, "suite.json says"),
        (_forget_a_case, "suite.json does not list it"),
        (_two_names, "other: the case calls itself follows, expected the name of its folder"),
        (_stale_baseline, "baseline of another content: idm in mirror"),
        (_baseline_of_nothing, "has a baseline (idm in mirror), but is not in the suite"),
    ],
)
def test_check_finds(spoil, said, tmp_path, capsys):
    folder = regression_cases.write(tmp_path / "suite")
    assert regents(capsys, "check", folder)[0] == 0
    spoil(folder)
    code, out, _ = regents(capsys, "check", folder, "--json")
    assert code == 1
    assert any(said in row["problem"] for row in json.loads(out))
    code, _, err = regents(capsys, "check", tmp_path)
    assert code == 2
    assert "no suite.json" in err


def test_a_case_of_two_names_is_driven_under_neither(tmp_path, capsys):
    """Its outcome would be accepted under a name that the suite does not list, so under none."""
    folder = regression_cases.write(tmp_path / "suite")
    _two_names(folder)
    for cases in (folder, folder / "other"):
        assert run(["evaluate", str(cases), "--planner", "log_replay", "--update"]) == 2
        assert "calls itself follows" in " ".join(capsys.readouterr().err.split())
    assert not (folder / "baseline.json").exists()
    alone = shutil.copytree(folder / "other", tmp_path / "elsewhere" / "mine")
    shutil.copytree(folder / "maps", alone.parent / "maps")
    assert load_case(alone).id == "follows", "in no suite a folder may have any name"


def test_merge(tmp_path, capsys):
    one, two = regression_cases.write(tmp_path / "one"), tmp_path / "two"
    SuiteWriter(two, 0).add(platoon())
    SuiteWriter(two, 0).add(regression_cases.follows())
    for folder, case in ((one, "pushes"), (two, "platoon0")):
        entries = {case: DriveOutcome(card_of(folder / case).hash, "no_collision")}
        save_baseline(folder / "baseline.json", Baseline().accepting("idm", "mirror", entries, entries))
    code, out, _ = regents(capsys, "merge", one, two, "-o", tmp_path / "both", "--json")
    assert (code, json.loads(out)) == (0, {"folder": str(tmp_path / "both"), "cases": 4})
    assert [e.case for e in load_manifest(tmp_path / "both").cases] == ["follows", "platoon0", "pushes", "squeezes_in"]
    assert sorted(load_baseline(tmp_path / "both" / "baseline.json").of("idm", "mirror")) == ["platoon0", "pushes"]
    assert regents(capsys, "check", tmp_path / "both")[0] == 0

    SuiteWriter(two, 0).add(replace(regression_cases.follows(), target=(1.0, 2.0)))
    code, _, err = regents(capsys, "merge", one, two, "-o", tmp_path / "clash")
    assert code == 2
    assert "case follows is in" in err
    assert not (tmp_path / "clash").exists()
    assert regents(capsys, "merge", one, "-o", tmp_path / "alone")[0] == 2


@pytest.mark.slow
def test_judging_again_keeps_what_was_accepted(tmp_path, capsys):
    """A suite of an older version: its crashes are not judged, one has a picture, and a baseline was accepted."""
    folder = regression_cases.write(tmp_path / "suite")
    hashes = {entry.case: entry.hash for entry in load_manifest(folder).cases}
    accepted = {case: DriveOutcome(digest, "no_collision") for case, digest in hashes.items()}
    save_baseline(folder / "baseline.json", Baseline().accepting("idm", "mirror", accepted, accepted))
    (folder / "pushes" / "still.png").write_bytes(b"old")
    (folder / "notes.txt").write_text("mine")

    code, out, _ = regents(capsys, "judge", folder, "-o", tmp_path / "judged", "--json")
    rows = {row["case"]: row for row in json.loads(out)}
    assert (code, sorted(rows)) == (0, ["pushes", "squeezes_in"])
    assert rows["pushes"]["before"] is None
    assert {entry.case: entry.hash for entry in load_manifest(folder).cases} == hashes, "the suite itself stays"

    assert regents(capsys, "judge", folder)[0] == 0
    for suite in (folder, tmp_path / "judged"):
        now = {entry.case: entry.hash for entry in load_manifest(suite).cases}
        assert {case for case in now if now[case] != hashes[case]} == {"pushes", "squeezes_in"}
        assert {
            case: one.hash for case, one in load_baseline(suite / "baseline.json").of("idm", "mirror").items()
        } == now
        assert load_case(suite / "pushes").judgement == load_case(folder / "pushes").judgement
        assert (suite / "pushes" / "still.png").read_bytes()[:4] == b"\x89PNG"
        assert regents(capsys, "check", suite)[0] == 0
    assert (folder / "notes.txt").read_text() == "mine"
    again = {entry.case: entry.hash for entry in load_manifest(folder).cases}
    assert regents(capsys, "judge", folder)[0] == 0
    assert {entry.case: entry.hash for entry in load_manifest(folder).cases} == again, (
        "the same verdicts, the same bytes"
    )
    code, _, err = regents(capsys, "judge", tmp_path)
    assert (code, "is not a suite" in err) == (2, True)
