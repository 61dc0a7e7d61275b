"""How usual a motion is: its rank among continuations of the same moment."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import DT, scene
from usual_scenes import STEPS, driven, traffic
from walkers import walked

from regents_cosim.benchmarks.table1 import table1
from regents_cosim.benchmarks.table1_sections import markdown
from regents_cosim.cases.files import load_case
from regents_cosim.cases.shipped import network
from regents_cosim.evaluation.crashes.scores import USUAL, MethodRun, scores
from regents_cosim.saving import save_unlisted
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.sources.record import record
from regents_cosim.verdicts.judge import judge
from regents_cosim.verdicts.usualness import peak_effort, rank, usualness


def rank_of(made: Scenario, car: int = 3, log: Scenario | None = None) -> float:
    found = rank(made, (log or made).tracks, car, made.tracks, STEPS)
    assert found is not None
    return found


@pytest.mark.slow
def test_traffic_itself_is_ordinary():
    found = np.sort([rank_of(traffic(seed=seed), car) for seed in range(4) for car in range(12)])
    away = np.abs(found / 100.0 - (np.arange(len(found)) + 0.5) / len(found)).max()  # Kolmogorov and Smirnov
    assert away < 0.3
    assert np.mean(found < 5.0) < 0.07


@pytest.mark.slow
def test_recorded_traffic_itself_is_ordinary():
    windows = record(network("signals"), count=3, seed=100)
    ranks = [
        rank(one, one.tracks, car, one.tracks, one.tracks.steps)
        for one in windows
        for car in range(len(one.agents))
        if np.ptp(one.tracks.x[car][one.tracks.valid[car]]) > 5.0
    ]
    found = np.array([one for one in ranks if one is not None])
    assert np.mean(found < 5.0) < 0.1
    assert 30.0 < np.median(found) < 80.0


@pytest.mark.slow
@settings(max_examples=30)
@given(brake=st.floats(0.5, 6.0), more=st.floats(0.2, 3.0), begin=st.integers(5, 40))
def test_harder_braking_is_less_usual(brake, more, begin):
    made = traffic()
    braking = (np.arange(STEPS - 1) >= begin) & (np.arange(STEPS - 1) < begin + 20)
    gentle, hard = (rank_of(driven(made, 3, np.where(braking, -by, 0.0)), log=made) for by in (brake, brake + more))
    assert hard <= gentle


def test_steps_longer_than_a_second_are_no_error():
    made = replace(traffic(), dt=2.5)
    assert 0.0 < rank_of(made) <= 100.0
    assert peak_effort(made.tracks.speed[0], made.tracks.yaw[0], made.dt) >= 0.0


def test_what_no_vehicle_does_is_rare():
    made = traffic()
    assert rank_of(driven(made, 3, np.where(np.arange(STEPS - 1) < 15, -8.0, 0.0)), log=made) < 5.0


def test_the_same_moment_has_the_same_continuations():
    made = traffic()
    assert rank_of(made) == rank_of(replace(made, id="another-name"))


@pytest.mark.parametrize("change", ["bicycle", "short"])
def test_what_cannot_be_told_is_not_known(change):
    made = traffic()
    if change == "bicycle":
        agents = tuple(replace(a, kind="bicycle") if i == 3 else a for i, a in enumerate(made.agents))
        assert rank(replace(made, agents=agents), made.tracks, 3, made.tracks, STEPS) is None
    else:
        assert rank(made, made.tracks, 3, made.tracks, 15) is None


def test_alone_it_is_compared_with_its_kind():
    alone = scene((0, 0, 12), (60, 0, 12), steps=STEPS)
    steady, braking = (rank_of(driven(alone, 1, np.full(STEPS - 1, by)), 1, alone) for by in (0.0, -6.0))
    assert steady == 100.0
    assert braking < 25.0


def test_who_walks_is_compared_with_those_who_walk():
    time = DT * np.arange(STEPS)
    made = scene(*((40.0 * i, 0.0, 12.0) for i in range(9)), steps=STEPS)
    for walker in range(1, 9):
        made = walked(made, walker, (1.2 + 0.05 * walker) * time + 0.1 * np.sin(time + walker), 9.0 + walker + 0 * time)
    steady = 30.0 + 1.3 * time
    darts = np.where(time < 3.0, steady, steady + 1.2 * np.clip(time - 3.0, 0.0, 1.0) ** 2)
    usual_walk, dart = (rank_of(walked(made, 1, x, 8.0 + 0 * time), 1, made) for x in (steady, darts))
    assert usual_walk == 100.0
    assert dart < 20.0


def test_a_judged_case_keeps_it_and_an_older_one_has_none(tmp_path):
    from table_runs import crashed

    older = crashed("a")
    assert usualness(older) is not None
    assert load_case(save_unlisted(older, tmp_path)).judgement.usual is None
    judged = judge(older)
    assert judged.judgement.usual == usualness(older)
    assert load_case(save_unlisted(judged, tmp_path)).judgement.usual == judged.judgement.usual


def test_success_falls_with_how_usual_an_adversary_has_to_be():
    from table_runs import AVOIDS, LAWFUL, crashed

    cases = [crashed(name, law=LAWFUL, drivers=AVOIDS) for name in "abcd"]
    ranks = (3.0, 40.0, 40.0, None)
    ranked = [replace(c, judgement=replace(c.judgement, usual=r)) for c, r in zip(cases, ranks, strict=True)]
    found = scores(MethodRun("king", "idm", 1, [[case] for case in ranked]))
    assert list(found.telling_by_usual) == [str(least) for least in USUAL]
    assert [found.telling_by_usual[str(least)] for least in (0, 5, 40, 45)] == [100.0, 50.0, 50.0, 0.0]
    assert (found.usual_percent, found.usual_unknown) == (40.0, 1)


def test_the_table_says_success_by_how_usual_it_is():
    from table_runs import KINGS

    assert "at least so usual" in markdown(table1([KINGS]))
