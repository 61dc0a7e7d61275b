"""The map of behaviours: which cell a crash belongs to, which one is the best there, and what a suite covers."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_crashes import braked, window
from shipped_cases import crash_on

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case, load_header
from regents_cosim.cli import run
from regents_cosim.runs.behaviour_map import AXES, STANDINGS, Archive, Crash, cell_of, crash_in, crash_of
from regents_cosim.saving import SuiteWriter, save_unlisted
from regents_cosim.tags.table import MANOEUVRES


def crash(number=0, *, tags=("cut_in",), closing=7.0, departs=2.5, standing=3, usual=50.0, off=1.0):
    return Crash(f"case{number}", f"{number:04d}", tags, closing, departs, STANDINGS[standing], usual, off)


# Plain values, of which the test makes crashes.
values = st.lists(
    st.fixed_dictionaries({
        "tags": st.lists(st.sampled_from(MANOEUVRES), max_size=2).map(tuple),
        "closing": st.floats(0.0, 60.0),
        "departs": st.none() | st.floats(0.0, 30.0),
        "standing": st.integers(0, 3),
        "usual": st.none() | st.sampled_from([0.0, 50.0, 100.0]),
        "off": st.sampled_from([0.0, 1.0]),
    }),
    max_size=20,
)  # fmt: skip


@given(values, st.randoms())
def test_the_elites_do_not_depend_on_the_order_and_are_the_best(found, random):
    crashes = [crash(at, **of) for at, of in enumerate(found)]
    archive, shuffled = Archive(crashes), Archive(random.sample(crashes, len(crashes)))
    assert list(archive.elites.items()) == list(shuffled.elites.items())
    assert archive.qd_score == shuffled.qd_score
    for cell, best in archive.elites.items():
        assert best.quality == max(one.quality for one in crashes if cell_of(one) == cell)
        assert all(label in axis.labels for label, axis in zip(cell, AXES, strict=True))
    assert archive.crashes == len(crashes)


@given(values)
def test_a_crash_improves_an_archive_exactly_when_its_score_or_its_elite_changes(found):
    archive = Archive()
    for at, of in enumerate(found):
        one = crash(at, **of)
        said, before = archive.improves(one), dict(archive.elites)
        cell = archive.add(one)
        assert bool(said) == (archive.elites != before)
        assert (said == "new cell") == (cell not in before)


def test_telling_comes_before_avoidable_before_clean_then_the_gentler():
    ladder = [crash(at, standing=at, usual=0.0) for at in range(4)]
    gentle = [
        crash(4 + at, standing=3, usual=usual, off=off) for at, (usual, off) in enumerate([(9.0, 2.0), (9.0, 1.0)])
    ]
    assert sorted([*gentle, *ladder], key=lambda one: one.order) == [*gentle[::-1], *ladder[::-1]]


def test_a_value_lies_in_the_bin_that_it_begins():
    manoeuvre, closing, departure = AXES
    assert [closing.of(crash(closing=speed)) for speed in (0.0, 4.999, 5.0, 19.0, 20.0, 99.0)] == [
        "0-5 m/s", "0-5 m/s", "5-10 m/s", "15-20 m/s", "20+ m/s", "20+ m/s",
    ]  # fmt: skip
    assert departure.of(crash(departs=None)) == "not seen"
    assert manoeuvre.of(crash(tags=("wrong_way", "cut_in", "junction"))) == "cut_in"
    assert manoeuvre.of(crash(tags=("junction",))) == "none"


def test_a_saved_case_needs_no_tracks_and_its_hash_knows_nothing_of_the_map(tmp_path):
    case = braked(window(3), "crash", 6.0, 8.0, 40.0, spoilt=False)
    folder = save_unlisted(case, tmp_path)
    seen = crash_of(case)
    assert crash_in(folder) == seen
    assert 2.0 < case.collision.time_s - seen.departs_s < 3.0  # it brakes after 2 s, and is seen when 0.5 m off
    assert load_header(folder).hash == content_hash(case) == content_hash(load_case(folder))
    text = (folder / "scenario.json").read_text()
    (folder / "scenario.json").write_text(text.replace('"behaviour"', '"not_known_yet"'))
    assert crash_in(folder) == seen  # as an older version wrote it


def test_traffic_and_harmless_neighbours_are_no_crashes(tmp_path):
    hit = crash_on("merge")
    assert crash_in(hit) is not None
    assert crash_in(hit.with_name(f"{hit.name}-harmless")) is None
    assert crash_in(save_unlisted(window(0), tmp_path)) is None


def test_a_map_is_summed_up():
    found = Archive([crash(0), crash(1, tags=("run_red_light",)), crash(2, standing=0)])
    assert found.summary() == "2 of 495 cells filled by 3 crashes (2 telling), QD score 9"


# --- commands ---------------------------------------------------------------------------------


@pytest.fixture
def suite(tmp_path):
    """A suite of three crashes in two cells by closing speed, and one window without a crash."""
    writer = SuiteWriter(tmp_path / "suite", 0)
    for number, closing in enumerate((3.0, 4.0, 12.0)):
        writer.add(braked(window(number), f"crash{number}", 6.0, closing, 40.0, spoilt=False))
    writer.add(window(3))
    return writer.folder


def test_coverage_is_printed_and_asked_for(suite, capsys):
    assert run(["suite", "coverage", str(suite), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["filled"], found["crashes"], found["cells"]) == (2, 3, 495)
    assert run(["suite", "coverage", str(suite)]) == 0
    printed = capsys.readouterr().out
    (row,) = [line for line in printed.splitlines() if line.startswith("hard_brake  ") and "..." in line]
    assert row.split() == ["hard_brake", "...C.....", ".........", "...C.....", ".........", "........."]
