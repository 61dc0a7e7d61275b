"""Suites of any size: cases are loaded when they are asked for, and not kept."""

import gc
import weakref

import pytest
from scenes import platoon

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.suite import CasesOnDisk, cases_in_turn, cases_on_disk, load_suite
from regents_cosim.cli import run
from regents_cosim.errors import CaseError
from regents_cosim.saving import SuiteWriter


@pytest.fixture(scope="module")
def suite(tmp_path_factory):
    writer = SuiteWriter(tmp_path_factory.mktemp("large") / "suite", 0)
    for seed in range(5):
        writer.add(platoon(3, seed))
    return writer.folder


def test_they_are_what_a_loaded_suite_is(suite):
    cases, loaded = cases_on_disk(suite), load_suite(suite)
    assert len(cases) == 5
    assert [content_hash(case) for case in cases] == [content_hash(case) for case in loaded]
    assert [header.id for header in cases.headers()] == [case.id for case in loaded]
    assert [case.id for case in cases[1::2]] == ["platoon1", "platoon3"]
    assert isinstance(cases[1::2], CasesOnDisk)
    assert [case.id for case in cases_in_turn(loaded, slice(3, None))] == ["platoon3", "platoon4"]


def test_none_of_them_is_kept(suite):
    seen = [weakref.ref(case) for case in cases_on_disk(suite)]
    gc.collect()
    assert not any(case() for case in seen)


def test_one_that_cannot_be_read_fails_before_any_work(suite, tmp_path):
    writer = SuiteWriter(tmp_path / "suite", 0)
    for seed in range(2):
        writer.add(platoon(3, seed))
    (writer.folder / "platoon1" / "tracks.npz").write_bytes(b"")
    with pytest.raises(CaseError, match="platoon1"):
        cases_on_disk(writer.folder)


@pytest.mark.slow
def test_shards_of_an_evaluation_drive_every_case_once(suite, tmp_path, capsys):
    for number in (1, 2):
        words = ["evaluate", str(suite), "--planner", "constant_velocity", "--shard", f"{number}/2", "--json", "-o"]
        assert run([*words, str(tmp_path / f"{number}")]) == 0
        assert f'"n": {4 - number}' in capsys.readouterr().out
    assert run(["evaluate", str(suite), "--planner", "constant_velocity", "--shard", "6/6"]) == 2
    assert "shard 6/6 holds no case" in capsys.readouterr().err
