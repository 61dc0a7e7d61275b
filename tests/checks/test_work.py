"""What a file may ask for grows with its size alone."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.checks.work import Work
from regents_cosim.errors import InputError


@given(st.integers(0, 10**9), st.lists(st.integers(0, 10**6), max_size=20))
def test_values_are_counted_over_the_whole_file(size, counts):
    work, most = Work(size), Work(size).most
    spent = 0
    for count in counts:
        spent += 2 * count
        if spent <= most:
            work.spend("x", 2, count)
        else:
            with pytest.raises(InputError, match="more than"):
                work.spend("x", 2, count)


def test_the_error_says_what_is_too_many_and_how_many_are_allowed():
    with pytest.raises(InputError) as found:
        Work(20_480).spend("lights x instants", 4_000, 100_000)
    said = str(found.value)
    assert said.startswith(
        "lights x instants: 4,000 x 100,000, which makes more than 4,327,680 values of a file of 20 KiB"
    )


def test_a_larger_file_may_ask_for_more(tmp_path):
    file = tmp_path / "log"
    file.write_bytes(bytes(1_000_000))
    Work.of(file).spend("samples", 15_000_000)
    assert Work(1_000_000).most == Work.of(file).most > Work(0).most
