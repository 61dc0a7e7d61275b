"""A ledger that is cut off anywhere is one of fewer units, and a finished one has the same bytes whatever happened."""

import os
from threading import Timer

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from regents_cosim.errors import CaseError, RegentsError
from regents_cosim.runs.identity import identity
from regents_cosim.runs.ledger import FOLDER, DoneUnit, WorkUnit, open_ledger, read_record
from regents_cosim.runs.shards import WHOLE, Shard
from regents_cosim.runs.status import status_of
from regents_cosim.system.files.locks import LOCK, try_lock

RUN = identity("attack", {"method": "king", "count": 4}, {"idm": ""})
UNITS = [WorkUnit(f"window{i}", RUN.key(str(i))) for i in range(5)]


def done(unit):
    return DoneUnit(unit, ((f"{unit.name}-king", "0" * 64),), {"replays": {"a": {"verified": True}}})


def work(folder, *, stop_after=99, run=RUN, shard=WHOLE, fails=()):
    """Run a session that does the units left, and stops after `stop_after` units."""
    with open_ledger(folder, run, shard) as ledger:
        if ledger.record.plan is None or ledger.changed:
            ledger.plan("traffic", [WorkUnit(unit.name, run.key(unit.name)) for unit in UNITS])
        for unit in ledger.left()[:stop_after]:
            ledger.note(msgspec.structs.replace(done(unit), error="boom" if unit.name in fails else ""))
        if not ledger.left():
            ledger.finish()


def tree(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@settings(max_examples=25, deadline=None)
@given(stops=st.lists(st.integers(0, 3), max_size=4), cuts=st.lists(st.integers(0, 2000), max_size=3))
def test_stopped_and_cut_off_anywhere_it_ends_with_the_same_bytes(tmp_path_factory, stops, cuts):
    whole, stopped = (tmp_path_factory.mktemp(name) for name in ("whole", "stopped"))
    work(whole)
    for at, stop in enumerate(stops):
        work(stopped, stop_after=stop)
        file = stopped / FOLDER / "ledger.jsonl"
        if at < len(cuts):  # a kill in the middle of a write
            text = file.read_bytes()
            file.write_bytes(text[: max(len(text) - cuts[at], 0)])
    work(stopped)
    assert tree(stopped) == tree(whole)


def test_other_settings_are_refused_and_both_are_named(tmp_path):
    work(tmp_path, stop_after=2)
    other = identity("attack", {"method": "focused", "count": 4}, {"idm": ""})
    before = tree(tmp_path)
    with pytest.raises(CaseError, match=r'begun with method "king", this run has method "focused".*-o'):
        work(tmp_path, run=other)
    assert tree(tmp_path) == before


def test_another_shard_is_refused(tmp_path):
    work(tmp_path, shard=Shard(1, 2))
    with pytest.raises(CaseError, match="begun as shard 1/2, this is shard 2/2"):
        work(tmp_path, shard=Shard(2, 2))


def test_a_changed_planner_is_never_skipped(tmp_path):
    work(tmp_path)
    changed = identity("attack", RUN.settings, {"idm": "other"})
    with open_ledger(tmp_path, changed) as ledger:
        assert ledger.changed == ["planner idm"]
        ledger.plan("traffic", [WorkUnit(unit.name, changed.key(unit.name)) for unit in UNITS])
        assert [unit.name for unit in ledger.left()] == [unit.name for unit in UNITS]
        assert ledger.record.done["window0"].cases  # known still, so that they can be removed


def test_failed_units_are_tried_again_only_when_asked(tmp_path):
    work(tmp_path, fails={"window2"})
    with open_ledger(tmp_path, RUN) as ledger:
        assert ledger.left() == []
        assert [unit.name for unit in ledger.left(retry=True)] == ["window2"]


def test_two_at_once_are_one_too_many(tmp_path):
    with open_ledger(tmp_path, RUN) as ledger:
        ledger.plan("", UNITS)
        with pytest.raises(RegentsError, match="another process"), open_ledger(tmp_path, RUN):
            pass
        assert status_of(tmp_path).state == "running"


def test_a_look_at_the_status_does_not_refuse_a_run_that_begins_meanwhile(tmp_path):
    work(tmp_path, stop_after=1)
    looking = try_lock(tmp_path / FOLDER / LOCK, os.O_RDWR | os.O_CREAT)
    Timer(0.05, os.close, [looking]).start()
    work(tmp_path)
    assert status_of(tmp_path).state == "finished"


def test_cases_of_a_unit_that_a_kill_cut_short_stay_known(tmp_path):
    """Other code may give the unit other cases, and these are to go."""
    with open_ledger(tmp_path, RUN) as ledger:
        ledger.plan("traffic", UNITS)
        ledger.note(done(UNITS[0]))
        ledger.note_begun("window0", ["window0-again"])
        ledger.note_begun("window1", ["window1-king"])
    with open_ledger(tmp_path, RUN) as ledger:
        assert ledger.left() == UNITS
        assert ledger.gone(UNITS[2:]) == ["window0-again", "window0-king", "window1-king"]
    assert status_of(tmp_path).done == 0


def test_status_counts_and_says_why(tmp_path):
    with pytest.raises(CaseError, match="no run in"):
        status_of(tmp_path)
    work(tmp_path, stop_after=3, fails={"window1"})
    found = status_of(tmp_path)
    assert (found.state, found.units, found.done, found.failed, found.left) == ("stopped", 5, 3, 1, 2)
    assert found.failures == (("window1", "boom"),)
    assert None not in (found.per_hour, found.left_s)
    work(tmp_path)
    assert (status_of(tmp_path).state, status_of(tmp_path).left) == ("finished", 0)


def test_a_run_that_fails_before_it_has_a_plan_leaves_nothing(tmp_path):
    with pytest.raises(ZeroDivisionError), open_ledger(tmp_path / "new", RUN):
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())


def test_a_damaged_ledger_is_said_to_be_so(tmp_path):
    work(tmp_path)
    file = tmp_path / FOLDER / "ledger.jsonl"
    file.write_bytes(file.read_bytes().replace(b'"units"', b'"onions"'))
    with pytest.raises(CaseError, match="to begin again"):
        read_record(tmp_path)


@pytest.mark.parametrize("name", ["window2-king", "window2"])
def test_a_ledger_from_elsewhere_names_nothing_outside_its_folder(tmp_path, name):
    work(tmp_path)
    file = tmp_path / FOLDER / "ledger.jsonl"
    file.write_bytes(file.read_bytes().replace(f'"{name}"'.encode(), b'"../../elsewhere"'))
    with pytest.raises(RegentsError, match="of a ledger") as said:
        read_record(tmp_path)
    assert "\n" not in str(said.value)
