"""Episodes one after the other: one whose process dies costs no other."""

import os

import pytest

from regents_cosim.cases.shipped import network_config
from regents_cosim.live import episodes
from regents_cosim.live.episodes import EpisodeResult, Episodes, run_episodes
from regents_cosim.simulators.sumo.config import SumoInput, read_input


def _dies_once(made, seed):
    if seed == 1:
        os._exit(1)
    return EpisodeResult(seed, "arrived")


@pytest.mark.slow
def test_an_episode_whose_process_dies_costs_no_other(monkeypatch):
    monkeypatch.setattr(episodes, "run_episode", _dies_once)
    made = Episodes(read_input(SumoInput(config=network_config("crossing"))), "auto", "idm")
    ended = list(run_episodes(made, [0, 1, 2]))
    assert [(one.seed, one.how) for one in ended] == [(0, "arrived"), (1, "process died"), (2, "arrived")]
    (said,) = ended[1].told
    assert "the worker process died" in said
