"""A method of attack of the user's own: in one file, by name, by entry point, or as an object."""

import os
import re
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest
from command import regents
from places import ROOT
from shipped_cases import shipped_window

from regents_cosim import load_suite
from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.descent.search import in_one_look
from regents_cosim.attacks.methods import presets
from regents_cosim.attacks.methods.moves import Descend, LookAt, Search
from regents_cosim.attacks.methods.presets import (
    METHODS,
    REGENTS_FOCUSED,
    AttackConfig,
    ByRulesOfFocused,
    BySampling,
    preset,
)
from regents_cosim.attacks.sampling.sampled_search import CHANGES, COORDINATES, changed_actions
from regents_cosim.cli import run
from regents_cosim.errors import WRONG_USAGE, RegentsError
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.system import user_code

MINE = """from dataclasses import dataclass, field
from regents_cosim.attacks.methods.presets import AttackConfig, ByRulesOfFocused

class NoName(AttackConfig):
    pass

class Nameless(ByRulesOfFocused):
    pass

@dataclass(frozen=True, repr=False)
class Mine(ByRulesOfFocused):
    method: str = "mine"
    spread: float = 0.5
    \"\"\"how far a change goes [m]\"\"\"

@dataclass(frozen=True, repr=False)
class Clashing(ByRulesOfFocused):
    method: str = "clashing"
    seed: int = 0
    \"\"\"a seed\"\"\"

class Bare(ByRulesOfFocused):
    method: str = "bare"

@dataclass(frozen=True, repr=False)
class Elsewhere(ByRulesOfFocused):
    method: str = "../else"

@dataclass(frozen=True, repr=False)
class Listed(ByRulesOfFocused):
    method: str = "listed"
    speeds: list = field(default_factory=list)

NONE = 3
"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """The name of a method in a file."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "wrong.py").write_text("import math\nnothing\n")
    return "mine.py:Mine"


def test_it_is_found_in_its_file_and_takes_settings(mine):
    found = preset(mine, iterations=3, spread=2.0)
    assert (found.method, found.spread) == ("mine", 2.0)
    assert (found.steps.iterations, found.acceptance.accept) == (3, "telling")
    assert found.noted["spread"] == 2.0


def test_it_shares_the_programs_of_ours(mine):
    """Settings of its own are none of a program, and a kept program never holds a user's class."""
    assert preset(mine).compiled() == REGENTS_FOCUSED.compiled()
    assert type(preset(mine).compiled()) is AttackConfig


@pytest.mark.parametrize("method", METHODS.values(), ids=lambda one: one.method)
def test_a_method_has_fewer_than_ten_settings_in_each_part(method):
    parts = [part for part in vars(method).values() if is_dataclass(part)]
    own = [name for name, value in vars(method).items() if not is_dataclass(value)]
    assert len(own) < 10, f"{own}: put some into a part of their own"
    assert all(len(fields(part)) < 10 for part in parts)
    assert method.but(**method.settings) == method


def test_it_is_found_by_its_entry_point(monkeypatch):
    class Point:
        name, value = "theirs", "regents_cosim.attacks.methods.presets:THEIRS"

    monkeypatch.setattr(presets, "THEIRS", Ours(), raising=False)
    monkeypatch.setattr(user_code, "entry_points", lambda group: [Point] if group == presets.GROUP else [])
    assert preset("theirs").method == "ours"
    with pytest.raises(RegentsError, match="did you mean theirs"):
        preset("their")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("mine.py:Yours", "mine.py has no 'Yours' that is an AttackConfig"),
        ("mine.py:NONE", "mine.py has no 'NONE' that is an AttackConfig"),
        ("mine.py:NoName", "'mine.py:NoName' cannot be made: TypeError"),
        ("mine.py:Nameless", "its field 'method' is 'focused', one of ours, expected another name"),
        ("mine.py:Bare", "'mine.py:Bare': Bare has fields, but no @dataclass(frozen=True) above it"),
        ("mine.py:Elsewhere", "method '../else' holds a / or \\: expected the plain name of a file or folder"),
        ("mine.py:Listed", "'mine.py:Listed' cannot be made: TypeError: unhashable type: 'list'"),
        ("wrong.py:Mine", "cannot be imported: NameError: name 'nothing' is not defined (wrong.py, line 2)"),
        ("mine.py", "is a file: name the method in it as well, mine.py:CLASS"),
        ("nowhere.py:Mine", "cannot be imported"),
        ("focussed", "did you mean focused?"),
    ],
)
def test_what_is_no_method_is_said_in_one_line(mine, capsys, name, said):
    assert run(["attack", "shipped:quickstart", "-o", "out", "--method", name]) == WRONG_USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_a_file_of_settings_does_not_name_it(mine, tmp_path, capsys):
    (tmp_path / "a.toml").write_text(f'method = "{mine}"\n')
    assert run(["attack", "shipped:quickstart", "-o", "out", "--config", "a.toml"]) == WRONG_USAGE
    assert f"expected --method {mine} on the command line" in capsys.readouterr().err


def with_installed(*words):
    """A command that finds what `name` has installed."""
    return regents(*words, PYTHONPATH=os.pathsep.join([str(Path.cwd() / "installed"), str(ROOT)]))


@pytest.fixture(params=["file", "entry point"])
def name(mine, request):
    """The method by its file, and by the entry point of an installed package."""
    if request.param == "file":
        return mine
    about = Path("installed/mine-1.dist-info")
    about.mkdir(parents=True)
    Path("mine.py").rename("installed/mine.py")
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[regents_cosim.methods]\ntheirs = mine:Mine\n")
    return "theirs"


@pytest.mark.slow
def test_its_fields_stand_in_the_file_of_settings_and_no_others(name):
    written = with_installed("config", "attack", "--method", name)
    assert "# how far a change goes [m]\n#spread = 0.5\n" in written.stdout, written.stderr
    assert written.stdout.startswith(f"# The settings of `regents attack --method {name} --config FILE`.")
    words = ("attack", "shipped:quickstart", "-o", "out", "--config", "a.toml")
    for text, method, said in (
        ("spred = 2", name, "spred is no setting of it: did you mean spread"),
        ('spread = "far"', name, 'Invalid value for spread from a.toml: unable to convert "far" into float'),
        ("spread = nan", name, "--spread is nan, expected a finite number"),
        ("spread = -2.0", name, "was attacked already"),  # so the number is accepted: fields of its own may be negative
        ("spread = 2", "focused", "spread is no setting of it"),
    ):
        Path("a.toml").write_text(text)
        done = with_installed(*words, "--method", method)
        assert (done.returncode, done.stderr.count("\n")) == (WRONG_USAGE, 1), done.stderr
        assert said in done.stderr


def test_a_field_that_is_called_like_an_option_is_refused(mine, capsys):
    assert run(["config", "attack", "--method", "mine.py:Clashing"]) == WRONG_USAGE
    assert "a field that is called like --seed: expected another name" in capsys.readouterr().err
    assert run(["config", "attack"]) == 0


@dataclass(frozen=True, repr=False)
class Ours(ByRulesOfFocused):
    method: str = "ours"
    spread: float = 0.5
    """how far a change goes [m]"""


def test_a_file_names_a_method_of_ours_and_its_fields(mine, monkeypatch, capsys):
    monkeypatch.setitem(METHODS, "ours", Ours())
    Path("a.toml").write_text('method = "ours"\nspread = "far"\n')
    assert run(["attack", "shipped:quickstart", "-o", "out", "--config", "a.toml"]) == WRONG_USAGE
    assert 'Invalid value for spread from a.toml: unable to convert "far"' in capsys.readouterr().err


@pytest.mark.slow
def test_the_file_that_made_a_suite_is_kept_in_it(name):
    Path("a.toml").write_text(
        "spread = 1.5\niterations = 1\nstarts = 1\nnearest = 1\nattempts = 1\ncount = 1\nverify = false\n"
    )
    words = ("attack", "-c", "shipped:crossing", "--planner", "constant_velocity", "--config", "a.toml", "-o", "suite")
    done = with_installed(*words, "--method", name)
    assert done.returncode == 0, done.stderr
    kept = Path("suite/attack.toml").read_text()
    assert f"--method {name}\n" in kept
    assert "\nspread = 1.5\n" in kept
    (case,) = load_suite("suite")
    assert case.attack.settings["spread"] == 1.5


class _OneLookAround(Search):
    """Looks at the log, then at some changes of it at once."""

    def __init__(self, candidate, method):
        self.candidate, self.method, self.seen = candidate, method, []

    def propose(self):
        job = self.candidate.job
        if not self.seen:
            return Descend(job.start)
        changes = np.random.default_rng(0).normal(size=(4, 10))
        return LookAt(changed_actions(job, self.method, changes), len(changes))

    def advance(self, seen):
        self.seen.append(seen.after(self.seen[-1] if self.seen else None))

    @property
    def finished(self):
        return bool(self.seen) and (len(self.seen) == 2 or self.seen[-1].is_last)

    def result(self):
        return self.seen[-1] if self.seen else None


@dataclass(frozen=True, repr=False)
class LookAround(ByRulesOfFocused):
    method: str = "look-around"
    descends: ClassVar[bool] = False

    def begin(self, candidate):
        return _OneLookAround(candidate, self)


@pytest.mark.slow
def test_an_object_with_a_search_of_its_own_attacks():
    few = LookAround().but(iterations=20, nearest=1, starts=1)
    (case,) = attack(shipped_window("crossing"), few, "log_replay")
    assert (case.attack.method, case.attack.rollouts) == ("look-around", 1 + 4)
    (outside,) = attack(shipped_window("crossing"), few, "sumo")
    assert (outside.attack.method, outside.attack.outcome) == ("look-around", "no_collision")
    assert outside.attack.drives > 0


@dataclass(frozen=True, repr=False)
class Blind(BySampling):
    method: str = "blind"
    changes: tuple[int, ...] = (5, COORDINATES)
    value: float = 0.0

    def sampler(self, seed):
        return Same(self.changes, self.value)


class Same:
    def __init__(self, changes, value):
        self.proposed = np.full(changes, value)

    def ask(self):
        return self.proposed

    def tell(self, changes, costs):
        pass


@pytest.mark.slow
@pytest.mark.parametrize(
    "wrong", [Blind(), Blind(changes=(CHANGES, 4)), Blind(changes=(CHANGES, COORDINATES), value=np.nan)]
)
def test_a_sampler_has_to_propose_as_many_changes_as_are_looked_at(wrong):
    few = wrong.but(iterations=20, nearest=1, starts=0)
    expected = re.escape(f"expected finite numbers {[CHANGES, COORDINATES]}")
    with pytest.raises(RegentsError, match=f"method blind: Same.ask gives an array .*{expected}"):
        list(attack(shipped_window("crossing"), few, "log_replay"))


@pytest.mark.slow
def test_the_example_climbs_from_lawful_drives():
    """It spends what it may, and another seed of the same number finds the same again."""
    method = preset(f"{ROOT / 'examples' / 'own_method.py'}:HillClimbing", iterations=12, nearest=1, starts=1)
    hard = method.but(max_accel=0.3, max_braking=0.3, max_lateral_accel=0.2)
    first, again = (next(attack(shipped_window("crossing"), hard, "idm")) for _ in range(2))
    assert first.attack == again.attack
    assert (first.attack.method, first.attack.outcome) == ("hill-climbing", "no_collision")
    assert first.attack.settings["spread"] == 0.5
    assert first.attack.iterations >= 12


class Raising(Same):
    def __init__(self, way):
        super().__init__((CHANGES, COORDINATES), 0.0)
        self.way = way

    def ask(self):
        return np.zeros(1)[COORDINATES] if self.way == "ask" else super().ask()

    def tell(self, changes, costs):
        raise SystemExit("no more")


@dataclass(frozen=True, repr=False)
class RaisingSampler(BySampling):
    method: str = "raising"
    way: str = "ask"

    def sampler(self, seed):
        return Raising(self.way)


class RaisingSearch(_OneLookAround):
    def propose(self):
        raise KeyError(self.method.method)


@dataclass(frozen=True, repr=False)
class RaisingProposal(ByRulesOfFocused):
    method: str = "proposing"

    def begin(self, candidate):
        return RaisingSearch(candidate, self)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (RaisingSampler(), "method raising failed: IndexError: index 10 is out of bounds"),
        (RaisingSampler(way="tell"), "method raising failed: SystemExit: no more"),
        (RaisingProposal(), "method proposing failed: KeyError: 'proposing'"),
    ],
)
def test_what_a_method_raises_names_its_line(wrong, said):
    few = wrong.but(iterations=20, nearest=1, starts=0, attempts=1)
    with pytest.raises(RegentsError, match=rf"^{said}.* \(test_own_methods\.py, line \d+\)$"):
        list(attack(shipped_window("crossing"), few, "log_replay"))


class OneProposal(_OneLookAround):
    """Proposes one move, whatever it is."""

    def propose(self):
        return self.method.propose(self.candidate.job)

    def advance(self, seen):
        super().advance(seen)
        self.method.tell((self.candidate.job, seen.found))

    @property
    def finished(self):
        return bool(self.seen)


@dataclass(frozen=True, repr=False)
class Proposing(ByRulesOfFocused):
    method: str = "proposing"
    propose: object = None
    tell: object = None  # is called with the job and the end of every move

    def begin(self, candidate):
        return OneProposal(candidate, self)


def constant(job, accel):
    """Actions of one acceleration, straight on."""
    return ControlArrays(jnp.full((1, job.world.controls.accel.shape[1]), accel), job.world.controls.accel[:1] * 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("move", [Descend, lambda drive: LookAt(in_one_look([drive]), 1)])
def test_its_drives_are_held_to_its_limits(move):
    ended = []
    made = Proposing(propose=lambda job: move(constant(job, -9.0)), tell=ended.append)
    list(attack(shipped_window("crossing"), made.but(nearest=1, max_braking=0.5), "log_replay"))
    ((job, found),) = ended
    logged, driven = (np.asarray(of.accel)[int(job.searched.first)] for of in (job.world.controls, found.controls))
    assert (driven >= np.minimum(logged, -0.5) - 1e-4).all()
    assert driven.min() == pytest.approx(min(logged.min(), -0.5), abs=1e-4)


@dataclass(frozen=True, repr=False)
class WithoutSampler(BySampling):
    method: str = "without-sampler"

    def sampler(self, seed):
        return seed


@dataclass(frozen=True, repr=False)
class WithoutSearch(ByRulesOfFocused):
    method: str = "without-search"

    def begin(self, candidate):
        return candidate


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (WithoutSampler(), r"method without-sampler: sampler\(\) returns int without ask and tell, expected a Sampler"),
        (WithoutSearch(), r"method without-search: begin\(\) returns Candidate, expected a Search"),
        (Proposing(propose=lambda job: 3), r"OneProposal.propose\(\) returns int, expected Descend or LookAt"),
        (Proposing(propose=lambda job: Descend([0.0])), r"returns Descend with wrong start, expected ControlArrays of"),
        (Proposing(propose=lambda job: LookAt(constant(job, 0.0), 1)), r"wrong drives, .* of \[10, 1, 80\] numbers"),
    ],
)
def test_what_a_method_makes_has_to_be_what_it_says(wrong, said):
    few = wrong.but(iterations=20, nearest=1, starts=0, attempts=1)
    with pytest.raises(RegentsError, match=said):
        list(attack(shipped_window("crossing"), few, "log_replay"))
