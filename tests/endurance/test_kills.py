"""The short form of `kills`: a command that writes a suite at once, and one with SUMO in processes of its own."""

import pytest

from benchmarks.endurance.kills import JOBS, prepare, run


def kills(count, jobs, tmp_path):
    tallies = run(count, seed=0, template=prepare(tmp_path / "template"), work=tmp_path, jobs=jobs)
    assert [(tally.job, tally.problems) for tally in tallies if tally.failures] == []
    assert sum(tally.kills for tally in tallies) == count
    return tallies


@pytest.mark.slow
def test_killed_at_any_moment_nothing_is_lost_and_nothing_keeps_running(tmp_path):
    kills(4, [job for job in JOBS if job.name in ("record", "suite merge")], tmp_path)
