"""The results table: shares with their intervals, pairs of methods, and a text and a picture of them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command import regents
from PIL import Image
from table_runs import AVOIDS, KINGS, LAWFUL, WINDOWS, crashed, missed

from benchmarks.measured.bars import PercentWithInterval, draw_bars
from regents_cosim.attacks.methods.presets import KING, METHODS, RANDOM, REGENTS, REGENTS_FOCUSED
from regents_cosim.benchmarks.runs import columns, traffic_of
from regents_cosim.benchmarks.table1 import compare, table1
from regents_cosim.benchmarks.table1_sections import markdown
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.evaluation.crashes.scores import MethodRun, rollouts_at_most, scores
from regents_cosim.scenario.judgement import Flaw, Law, Offence

UNLAWFUL = Law(
    (Offence("oncoming_lanes", 2.0, 1.0, 0.4, "share of its body"),), (Offence("speeding", 1.0, 1.0, 3.0, "m/s"),)
)


OTHERS = MethodRun("focused", "idm", 4000, [WINDOWS[0], WINDOWS[4], [crashed("c")], [crashed("d")], [crashed("e")]])


def test_windows_and_crashes_are_counted_apart():
    found = scores(KINGS)
    assert (found.windows, found.colliding_before, found.n) == (5, 1, 4)
    assert (found.successes, found.clean) == (3, 2)
    assert (found.success_percent, found.clean_percent) == (75.0, 50.0)
    assert (found.crashes, found.flaws) == (4, {"off_road": 2})
    assert found.preventions == {"unknown": 3, "not_preventable": 1}
    assert sum(found.collision_types.values()) == 4
    assert found.at_fault == {"adversary": 4}
    assert {reason: n for reason, n in found.failures.items() if n} == {
        "not_known": 1, "careful_driver_crashes_too": 1, "spoilt_only": 1, "stuck": 1,
    }  # fmt: skip
    assert found.deviation_m > 0.0
    assert found.impact_m_s == 4.0
    assert set(found.realism_distance) == {"accel", "lateral", "jerk", "yaw_rate"}


def test_only_windows_that_both_methods_could_attack_are_compared():
    found = compare(KINGS, OTHERS, "clean")
    assert (found.only_first, found.only_second) == (1, 2)
    assert found.p == pytest.approx(1.0)
    assert (compare(KINGS, OTHERS, "success").only_first, compare(KINGS, OTHERS, "success").only_second) == (1, 1)


def test_the_table_has_a_column_for_each_method():
    table = table1([KINGS, OTHERS, replace_planner(KINGS, "aim-bev")])
    text = markdown(table)
    assert "| clean success | 2 of 4: 50 % (15 to 85) | 3 of 4: 75 % (30 to 95) |" in text
    assert "| king : focused | 0 : 0, p = 1 | 0 : 0, p = 1 | 1 : 1, p = 1 | " in text
    assert text.count("###") == 2
    assert len(table.comparisons) == 4
    assert json.loads(json.dumps(table.to_dict()))["schema"] == 7


def replace_planner(run, planner):
    return MethodRun(run.method, planner, run.rollouts, run.windows)


def test_telling_is_the_headline_and_what_is_not_known_is_said():
    windows = [
        [crashed("b", law=LAWFUL, drivers=AVOIDS, at_fault="ego")],
        [crashed("c", law=UNLAWFUL, drivers=AVOIDS)],
        [crashed("d")],
        [
            crashed("e", [Flaw.OFF_ROAD], law=LAWFUL, drivers=AVOIDS, at_fault="ego"),
            crashed("e2", law=Law((), (), ("oncoming_lanes",))),
        ],
    ]
    run = MethodRun("king", "idm", 500, windows)
    found = scores(run)
    assert (found.telling, found.telling_unknown, found.clean) == (1, 2, 4)
    assert (found.flawless, found.offences) == (1, {"oncoming_lanes": 1})
    assert found.conducts == {"breaks_the_law_grossly": 1, "keeps_every_rule": 2, "unknown": 2}
    assert found.preventions == {"preventable": 3, "unknown": 2}
    assert found.failing_offences == {"oncoming_lanes": 1}
    text = markdown(table1([run]))
    assert text.splitlines()[4].startswith("| **telling success** | **1 of 4: 25 % (5 to 70); not known 2** |")
    assert "1 gross offence only (1 oncoming lanes), 2 not known" in text
    assert "| oncoming lanes | 33.3 %; not known 2 |" in text  # of 5 crashes; one not judged, one without directions
    assert "| the ego: speeding | 25.0 %; not known 1 |" in text
    assert text.splitlines()[5].startswith("| **flawless success** | **1 of 4: 25 % (5 to 70)** |")
    assert "| preventable | 3 preventable, 2 unknown |" in text
    assert "| adversary | 2 keeps every rule, 1 breaks the law grossly, 2 unknown |" in text
    mistaken = MethodRun("king", "idm", 500, [[crashed("f", law=LAWFUL, drivers=AVOIDS)], *windows])
    assert "| 0 % | 40.0 / 20.0 % |" in markdown(table1([mistaken]))


def test_no_p_value_compares_two_protocols():
    mine, theirs = (replace(run, protocol=kind.protocol) for run, kind in ((KINGS, KING), (OTHERS, REGENTS_FOCUSED)))
    assert compare(mine, theirs, "telling").p is None
    text = markdown(table1([mine, theirs]))
    assert "| king : focused | - | - | - | - |" in text
    assert "different protocols" in text
    same = replace(KINGS, protocol=KING.by_protocol_of(REGENTS_FOCUSED).protocol)
    assert compare(same, theirs, "success").p == 1.0
    assert "different protocols" not in markdown(table1([same, theirs]))


def test_a_protocol_is_how_one_searches_and_not_for_what():
    assert KING.protocol == REGENTS.protocol == KING.but(nearest=9).protocol
    assert REGENTS_FOCUSED.protocol not in (KING.protocol, RANDOM.protocol)
    assert RANDOM.by_protocol_of(REGENTS_FOCUSED).protocol == REGENTS_FOCUSED.protocol
    cost = REGENTS_FOCUSED.but(softmin_m=0.0, pull_from_behind=True, pull_standing=True, exclude_rear=False)
    assert cost.protocol == REGENTS_FOCUSED.protocol
    kept = KING.by_protocol_of(REGENTS_FOCUSED)
    assert (kept.method, kept.acceptance.accept) == ("king", "telling")
    assert (kept.cost, kept.rules) == (KING.cost, KING.rules)


def test_columns_of_equal_protocol():
    given = {"adversaries": "one", "attempts": 3}
    found = {column.name: column.config for column in columns((), True, given)}
    assert list(found)[:2] == ["king", "regents"]
    assert len(found) == len(METHODS) + 2  # those of the papers also as they are
    equal = [config for name, config in found.items() if name not in ("king", "regents")]
    assert len({config.protocol for config in equal}) == 1
    assert dict(found["focused"].protocol)["attempts"] == 3
    assert found["king"].candidates.search == "joint"


def test_a_run_without_crashes_has_no_means():
    found = scores(MethodRun("king", "idm", 500, [[missed("a")]]))
    assert (found.crashes, found.deviation_m, found.impact_m_s, found.realism_distance) == (0, None, None, {})
    assert markdown(table1([MethodRun("king", "idm", 500, [[missed("a")]])]))


def test_every_seed_gives_a_run_of_traffic_with_windows_of_its_own():
    of_all = traffic_of(["crossing"], [], (3, 4), count=2, prefer="none")
    assert [len(windows) for windows in of_all] == [2, 2]
    assert len({content_hash(window) for windows in of_all for window in windows}) == 4
    assert [one.provenance.seed for windows in of_all for one in windows] == [3, 3, 4, 4]


def test_the_budget_counts_every_search():
    assert rollouts_at_most(KING) == 500
    assert rollouts_at_most(REGENTS_FOCUSED) == 8 * (12 + 8 * 500)


def test_bars_are_as_high_as_their_shares(tmp_path):
    draw_bars(
        "title",
        ("success",),
        {"king": [PercentWithInterval(100.0, 90.0, 100.0)], "none": [PercentWithInterval(0.0, 0.0, 5.0)]},
        tmp_path / "b.png",
    )
    pixels = np.asarray(Image.open(tmp_path / "b.png").convert("RGB")).astype(int)
    scale, column = pixels.shape[0] / 360, int(80 * pixels.shape[1] / 480)
    colour = pixels[int(200 * scale), column]
    rows = np.flatnonzero((np.abs(pixels[:, column] - colour) < 8).all(axis=1)) / scale
    assert rows.min() == pytest.approx(72, abs=3)
    assert rows.max() == pytest.approx(360 - 44, abs=3)


@pytest.mark.slow
def test_our_preset_finds_more_telling_crashes_than_those_of_the_papers(tmp_path):
    """The table of the README on a few windows of a network."""
    small = ["--nets", "merge", "--count", "4", "--seed", "3", "--adversaries", "one"]
    regents("bench", "table1", *small, "-o", tmp_path, "--quiet", code=0)
    table = json.loads((tmp_path / "table1.json").read_text())
    found = {row["method"]: row for row in table["scores"]}
    assert set(found) == {"king", "regents", "focused"}
    assert found["focused"]["n"] >= 3
    assert found["focused"]["telling_percent"] >= 50.0
    assert not found["focused"]["flaws"]
    against = [c for c in table["comparisons"] if (c["second"], c["count"]) == ("focused", "telling")]
    assert {c["first"] for c in against} == {"king", "regents"}
    assert all(c["only_second"] > c["only_first"] and c["p"] is None for c in against)  # protocols differ
    assert all(row["verified_in_sumo"] == row["crashes"] for row in found.values())
