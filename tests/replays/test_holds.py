"""Whether a crash holds with the others replayed, reacting and driven by SUMO, in the real SUMO and the mirror."""

from dataclasses import replace

import numpy as np
import pytest
from shipped_cases import crash_on

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case, note_holds
from regents_cosim.replays.holds import verified_each
from regents_cosim.saving import save_case
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.scenario.judgement import Holds
from regents_cosim.scenario.scenario import Agent, Tracks
from regents_cosim.system.workers import local_processes
from regents_cosim.verdicts.judge import judge
from regents_cosim.verdicts.words import holds_words

ALL = Holds(replayed=True, reactive=True, sumo=True)


@pytest.fixture(scope="module")
def crash():
    return load_case(crash_on("crossing"))


def where_ego_is(tracks, steps):
    """One row of tracks: where the ego is at these (fractional) steps, and absent before and beyond."""
    end = tracks.steps - 1
    there = np.clip(steps, 0, end)
    row = {name: np.interp(there, np.arange(end + 1), getattr(tracks, name)[0]) for name in ("x", "y", "yaw", "speed")}
    row["speed"] = row["speed"] * np.gradient(steps)
    row["valid"] = (steps >= 0) & (steps <= end)
    return {name: np.where(row["valid"], values, 0.0)[None] for name, values in row.items()}


def with_car(case, steps, log_steps, speed=None):
    """The case with another car on the ego's own way, at the place that the ego has at `steps`, and in its log."""
    rows = where_ego_is(case.tracks, steps)
    if speed is not None:
        rows["speed"] = np.full_like(rows["speed"], speed)

    def joined(tracks, row):
        return Tracks(**{name: np.concatenate([getattr(tracks, name), row[name]]) for name in row})

    car = Agent("zz", "car", 4.5, 1.8)
    log = joined(case.log, where_ego_is(case.tracks, log_steps))
    return replace(case, agents=(*case.agents, car), tracks=joined(case.tracks, rows), log=log)


@pytest.mark.slow
def test_who_gets_between_the_ego_and_its_adversary_depends_on_who_drives_the_others(crash):
    now = np.arange(crash.tracks.steps)
    hit = crash.collision.step
    # It drives away ahead of the ego; its log stops there, and SUMO has to start it from standstill.
    ahead = with_car(crash, now + 12.0, np.minimum(now + 12.0, 30.0), speed=1.0)
    # It follows the ego, and in its log into its back: in the mirror it brakes.
    behind = with_car(crash, now - 15.0, now - 15.0 + np.maximum(0.5 * now - 15.0, 0.0))
    behind = replace(behind, attack=replace(behind.attack, settings=behind.attack.settings | {"background": "log"}))
    bare = replace(crash, id="bare", road=replace(crash.road, sumo_net=None))
    cases = [crash, replace(ahead, id="ahead"), replace(behind, id="behind"), bare]
    assert {first_contact(case.agents, case.tracks)[1] for case in cases} == {hit}
    with local_processes(1) as pool:
        found = {replay.case: (replay, holds) for replay, holds in verified_each(cases, pool)}
    assert all(replay.verified for replay, _ in found.values()), found
    assert found[crash.id][1] == ALL
    assert found["ahead"][1] == Holds(replayed=False, reactive=True, sumo=False)
    assert (found["behind"][1].replayed, found["behind"][1].reactive) == (False, True)
    assert found["bare"][1] == replace(ALL, sumo=None)


@pytest.mark.slow
def test_a_crash_without_a_judgement_is_verified_and_not_asked_further(crash):
    [(replay, holds)] = verified_each([replace(crash, judgement=None, evasion=None)])
    assert replay.verified
    assert holds == Holds()


def test_it_is_kept_in_the_case_and_not_hashed(crash, tmp_path):
    folder = save_case(replace(crash, judgement=replace(crash.judgement, holds=Holds())), tmp_path / "suite")
    note_holds(folder, replace(ALL, sumo=False))
    noted = load_case(folder)
    assert noted.judgement == replace(crash.judgement, holds=replace(ALL, sumo=False))
    assert content_hash(noted) == content_hash(crash)


@pytest.mark.slow
def test_a_new_judgement_keeps_it(crash):
    noted = replace(crash, judgement=replace(crash.judgement, holds=ALL))
    assert judge(noted).judgement.holds == ALL


@pytest.mark.parametrize(
    ("holds", "words"),
    [
        (ALL, "with the others replayed from the log, reacting in the mirror and driven by SUMO"),
        (replace(ALL, sumo=None), "with the others replayed from the log and reacting in the mirror"),
        (
            replace(ALL, sumo=False),
            "with the others replayed from the log and reacting in the mirror; not with the others driven by SUMO: "
            "the ego hits one of them first",
        ),
        (Holds(sumo=False), "not with the others driven by SUMO: the ego hits one of them first"),
        (Holds(), None),
    ],
)
def test_in_words(holds, words):
    assert holds_words(holds) == words
