"""Numbers that a user types: finite and in range, or one clear line."""

import math

import pytest

from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED
from regents_cosim.checks.ranges import Range
from regents_cosim.cli import run
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.suites.building import Recipe
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.sources.logs.cut import LogWindows
from regents_cosim.sources.windows import Windows

NAN, INF = math.nan, math.inf


@pytest.mark.parametrize("value", [NAN, INF, -INF, -0.1, 1.1, 10**400, "1", None, True])
def test_what_is_no_number_in_the_range_is_refused(value):
    with pytest.raises(RegentsError, match="share is .* expected .*: a share"):
        Range(0.0, 1.0, "a share").check("share", value)


def test_what_counts_is_whole():
    with pytest.raises(RegentsError, match="count is 1.5, expected a whole number: cars"):
        Range(0, 9, "cars", whole=True).check("count", 1.5)


NUMBERS = {name: value for name, value in REGENTS_FOCUSED.settings.items() if type(value) in (int, float)}


@pytest.mark.parametrize("name", NUMBERS)
def test_every_number_of_an_attack_is_checked(name):
    """Every number is checked by its type too, so that integers are never NaN (the tests check types at run time)."""
    for value in (NAN, INF, -1.0, 1e300) if isinstance(NUMBERS[name], float) else (-1, 10**300):
        with pytest.raises(RegentsError, match=f"{name} is .*expected"):
            REGENTS_FOCUSED.but(**{name: value})


@pytest.mark.parametrize("value", [NAN, INF, -1e9, -1.5])
def test_every_number_of_the_traffic_is_checked(value):
    for name in ("count", "seed", "horizon_s", "radius_m", "company"):
        with pytest.raises(RegentsError, match="expected"):
            Windows(**{name: value if name.endswith(("_s", "_m")) else -1})
    for name in ("begin_s", "end_s"):
        with pytest.raises(RegentsError, match="expected"):
            SumoInput(**{name: value})
    with pytest.raises(RegentsError, match="expected"):
        LogWindows(stride_s=value)


@pytest.mark.parametrize("name", ["windows", "attacked", "adversarial", "not_preventable", "ordinary", "seed"])
def test_every_number_of_a_recipe_is_checked(name):
    with pytest.raises(RegentsError, match=f"{name} is -1, expected"):
        Recipe(**{name: -1})


WORDS = [
    ("--max-deviation", "-1"), ("--max-deviation", "nan"), ("--max-lateral-accel", "-3"),
    ("--max-lateral-accel", "nan"), ("--nearest", "0"), ("--patience", "-1"), ("--iterations", "0"),
    ("--attempts", "0"), ("--replan-every", "-1"), ("--batch", "0"), ("--count", "0"), ("--horizon", "nan"),
    ("--radius", "inf"), ("--seed", "-1"), ("--seed", "99999999999"), ("--begin", "nan"), ("--end", "-7"),
]  # fmt: skip


@pytest.mark.parametrize(("option", "value"), WORDS, ids=" ".join)
def test_the_command_line_refuses_with_one_line(option, value, tmp_path, capsys):
    code = run(["attack", "-c", "sumo_nets/merge/merge.sumocfg", option, value, "-o", str(tmp_path / "out")])
    said = capsys.readouterr().err.splitlines()
    assert code == 2
    assert len(said) == 1
    assert value.lstrip("-").removesuffix(".0") in said[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "wrong", [{"epochs": 0}, {"lessons": 16}, {"drives": -1}, {"learning_rate": NAN}, {"frozen": 14}, {"evading": 1.0}]
)
def test_a_training_is_refused_before_it_begins(wrong):
    """16 lessons are fewer than one batch, so the training is refused before the traffic is read."""
    pytest.importorskip("torch")
    from regents_cosim.training.lessons.train import TrainConfig

    with pytest.raises(RegentsError, match="expected"):
        TrainConfig(**wrong)
