"""Cuts parts out of a case: some of its steps, or some of its agents."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from regents_cosim.scenario import Overlap, Scenario, Signal, Tracks


def cut(scenario: Scenario, begin: int, end: int) -> Scenario:
    """The steps from `begin` to `end`, both included, without agents that are absent throughout.

    The judgement of the whole case is dropped. The log of an attacked case is cut in the same way.
    """
    there = scenario.tracks.valid[:, begin : end + 1].any(axis=1)
    shorter = replace(
        scenario,
        tracks=_cut(scenario.tracks, begin, end),
        log=scenario.log and _cut(scenario.log, begin, end),
        signals=tuple(_cut_signal(signal, begin, end) for signal in scenario.signals),
        overlaps=tuple(
            Overlap(pair.agents, max(pair.first_step - begin, 0), min(pair.last_step, end) - begin)
            for pair in scenario.overlaps
            if pair.first_step <= end and pair.last_step >= begin
        ),
        provenance=replace(scenario.provenance, begin_s=round(scenario.provenance.begin_s + begin * scenario.dt, 9)),
        judgement=None,
        evasion=None,
    )
    return shorter.keeping(np.asarray(there))


def without(scenario: Scenario, names: Collection[str]) -> Scenario:
    """The case without the agents of these ids."""
    return scenario.keeping(np.array([agent.id not in names for agent in scenario.agents]))


def _cut(tracks: Tracks, begin: int, end: int) -> Tracks:
    parts = {name: getattr(tracks, name)[:, begin : end + 1] for name in ("x", "y", "yaw", "speed", "valid", "z")}
    if tracks.accel is None or tracks.curvature is None:
        return Tracks(**parts)
    return Tracks(**parts, accel=tracks.accel[:, begin:end], curvature=tracks.curvature[:, begin:end])


def _cut_signal(signal: Signal, begin: int, end: int) -> Signal:
    later = tuple((step - begin, letters) for step, letters in signal.changes if begin < step <= end)
    return replace(signal, changes=((0, signal.letters(begin)), *later))
