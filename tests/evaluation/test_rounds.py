"""Rounds of attack and training: no window is met twice, ordinary driving is the gate, a stop changes nothing."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from blind_weights import save_blind
from hypothesis import given
from hypothesis import strategies as st
from scenes import crash, platoon, scene

from regents_cosim.attacks.methods.presets import METHODS
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.provenance import sha256_of
from regents_cosim.cases.shipped import network
from regents_cosim.cli import run
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.drives.driving import DriveResult
from regents_cosim.planners.aim_bev.weights_file import SHIPPED
from regents_cosim.runs.archive.axes import Axes
from regents_cosim.runs.steps import Steps
from regents_cosim.saving import SuiteWriter
from regents_cosim.system.progress import SILENT, Silent
from regents_cosim.training.before_after import hold_back
from regents_cosim.training.fresh_windows import FreshWindows
from regents_cosim.training.lessons.train_config import FINE_TUNING
from regents_cosim.training.rounds import rounds_folder, train_adversarially
from regents_cosim.training.rounds_course import attacked_drive, gate, held_out_rows
from regents_cosim.training.rounds_settings import Rounds

WINDOW = platoon(1)
DRIVEN = st.tuples(st.floats(0.0, 1.0), st.booleans())


def drive(completion, hits):
    return DriveResult("case", "made by hand", completion, 1.0, completion, "other" if hits else None, None, 0.0)


@given(st.lists(st.tuples(DRIVEN, DRIVEN), min_size=1, max_size=30))
def test_the_gate_lets_pass_who_drives_as_far_and_crashes_no_more(pairs):
    before, after = ([drive(*pair[side]) for pair in pairs] for side in (0, 1))
    found = gate(before, after)
    assert found.passed == (
        sum(a.completion - b.completion for a, b in zip(before, after, strict=True)) <= 0.02 * len(pairs)
        and found.collisions_after <= found.collisions_before
    )
    if found.lost_interval_points:
        low, high = found.lost_interval_points
        assert low - 0.1 <= found.lost_points <= high + 0.1
    assert (found.lost_interval_points is None) == (len(pairs) == 1)
    assert gate(before, before).passed


@given(st.lists(st.integers(0, 12), max_size=6))
def test_every_fifth_window_of_all_rounds_is_held_back(counts):
    rounds = [[replace(WINDOW, id=f"window{at}") for at in range(count)] for count in counts]
    before, held = 0, 0
    for windows in rounds:
        taught, chosen_by = hold_back(windows, before)
        assert {one.id for one in taught}.isdisjoint(one.id for one in chosen_by)
        before, held = before + len(windows), held + len(chosen_by)
        assert held == before // 5


def fresh(*nets, first_seed=3):
    return FreshWindows(nets, first_seed, 8.0, Steps(Path("nowhere")), SILENT)


def test_no_two_rounds_have_the_same_seed():
    assert [fresh("crossing").seed(number) for number in (1, 2, 3)] == [3, 4, 5]


@pytest.mark.parametrize("nets", [(), ("crossing", "crossing"), ("crossing", "elsewhere/crossing.sumocfg")])
def test_networks_need_names_of_their_own(nets):
    with pytest.raises(RegentsError, match="each under a name of its own"):
        fresh(*nets)


@pytest.mark.parametrize(("seed", "seen"), [(2, False), (3, True), (5, True), (6, False)])
def test_cases_of_a_seed_that_a_round_takes_are_refused(seed, seen):
    made = platoon(2)
    own = replace(made.provenance, sha256=sha256_of(network("crossing")), seed=seed)
    cases = [made, replace(made, provenance=own)]
    if seen:
        with pytest.raises(RegentsError, match="seeds 3 to 5 are those of fresh windows"):
            fresh("crossing").require_unseen(cases, 3)
    else:
        fresh("crossing").require_unseen(cases, 3)


def test_a_crash_that_tells_nothing_does_not_count_against_the_planner():
    made = scene((0, 0, 10.0), (40, 0, 10.0))
    crashed = crash(made, scene((0, 0, 10.0), (20, 0, 0.0)).tracks)
    assert crashed.judgement is None
    assert attacked_drive([crashed]).hits is None
    assert attacked_drive([made]).completion == 1.0


def test_the_log_teaches_no_rounds():
    with pytest.raises(RegentsError, match="rounds need --teacher idm"):
        Rounds(training=replace(FINE_TUNING, teacher="log"))


@pytest.fixture(scope="module")
def ordinary(tmp_path_factory):
    """A suite of windows of a shipped network, with the seed that the first round takes."""
    suite = SuiteWriter(tmp_path_factory.mktemp("ordinary") / "cases", 0)
    for seed in range(7):
        made = platoon(2, seed)
        own = replace(made.provenance, sha256=sha256_of(network("crossing")), seed=1)
        suite.add(replace(made, provenance=own))
    return suite.folder


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--finetune", "suite"], "leave out --finetune and --held-out"),
        (["--teacher", "log"], "rounds need --teacher idm"),
        (["--nets", "crossing"], "seeds 1 to 3 are those of fresh windows"),
        (["--nets", "nowhere"], "network 'nowhere' does not exist"),
        (["--nets", "signals", "--resume", "no.safetensors"], "no.safetensors"),
    ],
)
def test_what_no_round_can_be_made_of_is_said_at_once(ordinary, tmp_path, capsys, words, complaint):
    pytest.importorskip("torch", reason="torch is an extra")
    output = tmp_path / "tuned.safetensors"
    assert run(["train", "aim-bev", str(ordinary), "--adversarial", "2", "-o", str(output), *words]) == 2
    assert complaint in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


TINY = Rounds(
    rounds=1,
    nets=("crossing",),
    windows=18,
    held_out=1,
    attack=METHODS["starts"].but(nearest=4, adversaries="one"),
    training=replace(FINE_TUNING, epochs=1, lessons=64, drives=2, frozen=13),
    verify=False,
    axes=Axes(("closing_speed",)),
)


class Copies(Silent):
    """Copies the folder of the rounds, as a kill would leave it, when a training begins."""

    def __init__(self):
        self.places = []

    def each(self, items, what, total):
        if what == "training":
            self.places.append(Path(f"copy{len(self.places)}"))
            shutil.copytree(rounds_folder(Path("tuned.safetensors")), self.places[-1])
        yield from items


def tree(folder):
    found = {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    return {str(path): content for path, content in found.items() if path.name != ".lock"}


@pytest.mark.slow
def test_killed_in_its_last_training_it_ends_with_the_same_bytes(tmp_path, monkeypatch):
    """Egos that stand have nothing to lose at the gate, so that what a blind planner learns is kept."""
    pytest.importorskip("torch", reason="torch is an extra")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("regents_cosim.training.learning.SHARES", (1.0,))  # fewer drives to choose by
    blind, output = save_blind(Path("blind.safetensors")), Path("tuned.safetensors")
    standing = [scene((0, 0, 0.0), (30.0 + at, 3.2, 10.0), name=f"stands{at}") for at in range(7)]
    copies = Copies()
    whole = train_adversarially(standing, output, TINY, weights=blind, progress=copies)
    (first,) = whole.rounds
    assert first.windows == TINY.windows
    assert first.teachable > 0
    assert first.kept_percent is not None, "there is enough to learn from"
    assert len(find_cases(whole.suite)) >= first.suite_cells > 0
    assert (output.read_bytes() != blind.read_bytes()) == first.passed
    assert [(row.cases, row.weights, row.n) for row in whole.rows][-2:] == [
        ("attacks on each", "before", 1),
        ("attacks on each", "after", 1),
    ]
    expected, weights = tree(rounds_folder(output)), output.read_bytes()
    assert not [name for name in expected if "steps" in name], "what led there is not kept"

    shutil.rmtree(rounds_folder(output))
    output.unlink()
    shutil.move(copies.places[-1], rounds_folder(output))
    again = train_adversarially(standing, output, TINY, weights=blind)
    assert again == whole
    assert tree(rounds_folder(output)) == expected
    assert output.read_bytes() == weights

    output.unlink()
    assert train_adversarially(standing, output, TINY, weights=blind, progress=copies) == whole
    assert len(copies.places) == 1, "nothing is trained twice"
    assert output.read_bytes() == weights


@pytest.mark.slow
def test_weights_that_stay_are_driven_once():
    class Counts(Silent):
        def __init__(self):
            self.told = []

        def each(self, items, what, total):
            self.told.append(what)
            yield from items

    pytest.importorskip("torch", reason="torch is an extra")
    counts, windows = Counts(), [scene((0, 0, 0.0), (30.0, 3.2, 10.0), steps=11)]
    rows = held_out_rows(windows, ([windows], [windows]), (SHIPPED, SHIPPED), counts)
    assert counts.told == ["driving with aim_bev"]
    assert [(row.cases, row.weights, row.collisions) for row in rows] == [
        (cases, weights, 0) for cases in ("ordinary", "attacks on each") for weights in ("before", "after")
    ]
