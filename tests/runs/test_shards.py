"""Every unit of a run is in one shard, and SLURM's tasks are told which is theirs."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.errors import RegentsError
from regents_cosim.runs.shards import WHOLE, Shard, parse_shard, slurm_shard


@given(units=st.integers(0, 60), count=st.integers(1, 9), together=st.integers(1, 7))
def test_shards_divide_the_units_and_keep_neighbours_together(units, count, together):
    shares = [Shard(number, count).of(range(units), together) for number in range(1, count + 1)]
    assert sorted(unit for share in shares for unit in share) == list(range(units))
    assert all(share == sorted(share) for share in shares)
    for share in shares:
        for first in (unit for unit in share if unit % together == 0):
            assert set(range(first, min(first + together, units))) <= set(share)


def test_the_whole_is_one_shard():
    assert WHOLE.of("abc") == list("abc")


@given(count=st.integers(1, 99), first=st.integers(0, 5), step=st.integers(1, 4), data=st.data())
def test_tasks_of_an_array_are_shards_wherever_it_begins(count, first, step, data):
    task = data.draw(st.integers(0, count - 1))
    names = {"ID": first + step * task, "COUNT": count, "MIN": first, "STEP": step}
    environment = {f"SLURM_ARRAY_TASK_{name}": str(value) for name, value in names.items()}
    assert slurm_shard(environment) == Shard(task + 1, count)


def test_outside_of_an_array_there_is_none():
    assert slurm_shard({}) is None


@pytest.mark.parametrize("text", ["0/4", "5/4", "3", "3/", "a/b", "-1/4", "3/4/5", "1/9999999"])
def test_what_is_no_shard_is_said_in_one_line(text):
    with pytest.raises(RegentsError, match="as in 3/64") as said:
        parse_shard(text)
    assert "\n" not in str(said.value)


def test_shards_are_written_as_they_are_read():
    assert str(parse_shard("3/64")) == "3/64"
