"""Who is asked at a look for a plan, and who at the next."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from regents_cosim.attacks.starts.timed_drives import Start
from regents_cosim.live.search import plans as search_module
from regents_cosim.live.search.plans import Search
from regents_cosim.live.settings import live_config

NAMES = ("ego", "a", "b", "c", "d")
DRIVE = Start(*np.zeros((4, 10)), meets=5, contact=(0.0, 0.0, 0.0), promise=0.0)


class Asked(Search):
    """A search that notes who is asked; `drives` have lawful drives, of which none crashes the ego as wanted.

    Those of `long` have many ways on. The ego drives at `speed` [m/s]. All have been looked at before, unless `first`.
    What it `samples` finds nothing.
    """

    def __init__(self, drives, long=(), speed=8.0, first=False, samples=False):
        super().__init__("idm", live_config("focused-live", samples))
        self.noted, self.lines, self._drives, self._long, self._turn = [], [], drives, long, 0
        self._ego = SimpleNamespace(speed=np.full((1, 10), speed))
        if not first:
            self._asked = dict.fromkeys(NAMES[1:], 0.0)

    def _in_loop(self, moment):
        return nullcontext(
            SimpleNamespace(moment=moment, unattacked=lambda: self._ego, samples=self.config.tries.samples > 0)
        )

    def _warm_up(self, loop):
        pass

    def _candidates(self, loop, ego, barred):
        for _ in NAMES[1:]:
            self._turn = self._turn % 4 + 1
            self._asked[NAMES[self._turn]] = 0.0
            yield self._turn

    def _starts(self, loop, agent, ego, speed_only, most_lines=None):
        self.lines.append(most_lines)
        self.noted.append(f"ask {NAMES[agent]}")
        return [DRIVE] if NAMES[agent] in self._drives else None

    def _takes_long(self, loop, agent):
        return NAMES[agent] in self._long

    def _plan_from(self, loop, agent, found):
        return None

    def _sampled(self, loop, missed, most):
        assert missed.start is DRIVE
        self.noted.append(f"sample {missed.name} {most}")

    def _descended(self, loop, agent, missed):
        assert missed.adversary == NAMES[agent]
        self.noted.append(f"descend {NAMES[agent]}")


@pytest.fixture
def moment():
    return SimpleNamespace(
        scenario=SimpleNamespace(agents=[SimpleNamespace(id=name) for name in NAMES]),
        traffic=SimpleNamespace(index=lambda name: NAMES.index(name), time_s=0.0),
    )


def looks(search, moment, count, **more):
    for _ in range(count):
        assert search.fresh(moment, **more) is None
    return search.noted


def test_a_look_asks_until_one_has_drives_and_the_next_goes_on_from_those_that_did_not_crash_as_wanted(moment):
    said = looks(Asked({"b", "c"}), moment, 5)
    assert said == ["ask a", "ask b", "descend b", "ask c", "descend c", "ask d", "ask a"]


def test_without_drives_every_look_asks_two_more(moment):
    assert looks(Asked(set()), moment, 2) == ["ask a", "ask b", "ask c", "ask d"]


def test_a_search_that_may_sample_does_so_in_the_step_after_a_look(moment):
    search = Asked({"b"}, samples=True)
    assert looks(search, moment, 1) == ["ask a", "ask b"]
    assert search.sampled() is None
    assert search.noted[2:] == ["sample b 60"]
    assert search.sampled() is None
    assert looks(search, moment, 1)[3:] == ["ask c", "ask d"]
    assert search.sampled() is None  # none of them had drives
    assert search.noted[5:] == []


def test_where_no_step_comes_between_two_looks_all_is_sampled_at_once(moment):
    said = looks(Asked({"b", "c"}, samples=True), moment, 2, at_once=True)
    assert said == ["ask a", "ask b", "sample b 200", "ask c", "sample c 200"]


def test_the_first_look_asks_all_and_samples_all_at_once(moment):
    search = Asked({"b", "c"}, samples=True, first=True)
    assert looks(search, moment, 1) == ["ask a", "ask b", "ask c", "ask d", "sample b 200", "sample c 200"]
    assert search.sampled() is None
    assert len(search.noted) == 6


def test_for_an_adversary_that_keeps_to_its_lane_nothing_is_sampled_and_the_next_look_descends(moment):
    search = Asked({"a"}, samples=True)
    assert looks(search, moment, 1, speed_only=True) == ["ask a"]
    assert search.sampled() is None
    assert looks(search, moment, 1, speed_only=True) == ["ask a", "descend a"]
    assert looks(Asked({"a"}, samples=True), moment, 1, speed_only=True, at_once=True) == ["ask a"]


def test_a_search_that_may_not_sample_does_nothing_between_two_looks(moment):
    search = Asked({"a"})
    looks(search, moment, 1)
    assert search.sampled() is None
    assert looks(search, moment, 1) == ["ask a", "descend a"]


def test_who_has_many_ways_on_is_enough_for_a_look(moment):
    assert looks(Asked(set(), long={"a"}), moment, 2) == ["ask a", "ask b", "ask c"]


def test_who_is_barred_by_then_is_not_descended_from(moment):
    search = Asked({"a"})
    looks(search, moment, 1)
    assert looks(search, moment, 1, barred={"a"})[1:] == ["ask b", "ask c"]


def test_the_first_look_asks_all_and_the_next_descends_from_the_nearest_that_had_drives(moment):
    said = looks(Asked({"b", "c"}, long={"a"}, first=True), moment, 3)
    assert said == ["ask a", "ask b", "ask c", "ask d", "descend b", "ask a"]


def test_an_ego_that_stands_all_the_time_is_not_attacked(moment):
    assert looks(Asked({"a"}, speed=0.0, first=True), moment, 2) == []


def test_where_a_plan_could_not_be_changed_its_own_vehicle_is_asked_alone(moment):
    search = Asked({"b", "c"})
    assert search.redrawn(moment, "c") is None
    assert search.noted == ["ask c"]


def test_another_run_knows_nothing_of_the_one_before(moment):
    search = Asked({"a"})
    looks(search, moment, 1)
    search.forget()
    assert looks(search, moment, 1)[1:] == ["ask b", "ask c", "ask d", "ask a"]


def test_where_the_next_look_will_descend_is_found_out_ahead(moment, monkeypatch):
    asked = []
    monkeypatch.setattr(search_module, "lawful_road", lambda scenario, agent: asked.append(scenario.agents[agent].id))
    search = Asked({"b"})
    search.prepare()
    looks(search, moment, 1)
    assert asked == []
    search.prepare()
    search.prepare()
    assert asked == ["b"]


def test_later_looks_drive_along_the_first_lines_alone(moment):
    search = Asked(set(), first=True, samples=True)
    looks(search, moment, 2)
    assert search.lines == [None] * 4 + [search_module._MOST_LINES] * 2
    in_training = Asked(set(), first=True)
    looks(in_training, moment, 1)
    assert in_training.lines == [search_module._MOST_LINES] * 4
