"""Steps on the way to a suite are kept: what was recorded and attacked is not done again."""

from dataclasses import replace

import pytest
from attack_sessions import Counted, StoppedError
from scenes import platoon
from test_attack_run import RUN, ends, tree

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.suite import load_suite
from regents_cosim.errors import CaseError
from regents_cosim.runs.status import runs_in
from regents_cosim.runs.steps import Steps


def test_traffic_is_recorded_once(tmp_path):
    recorded = []

    def record():
        recorded.append(1)
        return [platoon(3, seed) for seed in (1, 0)]

    steps = Steps(tmp_path / "suite")
    for _ in range(2):
        windows = steps.recorded("merge", {"windows": 2}, "digest", record)
        assert [one.id for one in windows] == ["platoon1", "platoon0"]
    assert len(recorded) == 1
    assert [(one.command, one.state) for one in runs_in(tmp_path / "suite")] == [("record", "finished")]
    steps.recorded("merge", {"windows": 2}, "other files", record)
    assert len(recorded) == 2
    with pytest.raises(CaseError, match="begun with windows 2, this run has windows 3"):
        steps.recorded("merge", {"windows": 3}, "digest", record)
    steps.clear()
    assert not list((tmp_path / "suite").iterdir())


@pytest.mark.slow
def test_an_attack_goes_on(tmp_path):
    windows = [platoon(4, seed) for seed in range(3)]
    run = replace(RUN, pictures=False)

    whole = Steps(tmp_path / "one").attacked("king", windows, run)
    with pytest.raises(StoppedError):
        Steps(tmp_path / "two").attacked("king", windows, run, Counted(stop_after=1))
    left = Counted()
    again = Steps(tmp_path / "two").attacked("king", windows, run, left)
    assert left.searched == 2
    assert [[content_hash(one) for one in its] for its in again] == [
        [content_hash(one) for one in its] for its in whole
    ]


def written(folder):
    """Lines of all ledgers below a folder, 0 while one of them is moved or removed."""
    try:
        return sum(len(ledger.read_bytes().splitlines()) for ledger in folder.rglob("ledger.jsonl"))
    except FileNotFoundError:
        return 0


@pytest.mark.slow
def test_a_suite_that_is_built_by_killed_commands_is_the_same(tmp_path):
    small = ("--windows", 3, "--adversarial", 2, "--ordinary", 1, "--method", "king")
    words = ("suite", "build", "--nets", "merge", *small, "-o", "suite")
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    assert ends(*words, cwd=tmp_path / "one")
    assert not ends(*words, cwd=tmp_path / "two", killed=lambda: written(tmp_path / "two") >= 4)
    assert ends(*words, cwd=tmp_path / "two")
    assert tree(tmp_path / "two") == tree(tmp_path / "one")
    cases = load_suite(tmp_path / "one" / "suite")
    assert {one.attack is None for one in cases} == {True, False}
    assert all(one.judgement.holds.sumo is not None for one in cases if one.judgement)
