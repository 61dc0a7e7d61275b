"""Work by threads: in order, and not all at once."""

import os
import time

import pytest

from regents_cosim.system.workers import in_turn


def test_results_come_in_order_and_items_are_taken_as_their_turn_comes():
    taken = []

    def items():
        for number in range(1000):
            taken.append(number)
            yield number

    def work(number, other):
        time.sleep(0.0001 * (number % 3))
        return 10 * number + other

    found = in_turn(work, items(), range(1000))
    assert [next(found) for _ in range(5)] == [11 * number for number in range(5)]
    assert len(taken) <= 5 + 2 * (os.cpu_count() or 1)
    assert list(found) == [11 * number for number in range(5, 1000)]


def test_what_fails_fails_in_its_turn_and_ends_the_work():
    found = in_turn(lambda number: 1 // (3 - number), range(100))
    assert [next(found) for _ in range(3)] == [0, 0, 1]
    with pytest.raises(ZeroDivisionError):
        next(found)
