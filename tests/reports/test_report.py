"""What the report says of cases, and how it is packed."""

import base64
import gzip
import hashlib
import html
import itertools
import json
import re
import shlex
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from command import regents
from hypothesis import given
from hypothesis import strategies as st
from scenes import moving

from regents_cosim import report
from regents_cosim.cases.shipped import shipped
from regents_cosim.cases.suite import load_suite
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.crashes.realism import motion
from regents_cosim.evaluation.drives.crash_verdict import CaseEnd, CrashVerdict
from regents_cosim.evaluation.drives.driving import DriveResult, judged
from regents_cosim.geometry.boxes import Boxes, distance
from regents_cosim.norms.limits import ACCEL_LIMIT, MOST_ACCEL_M_S2
from regents_cosim.reports.crash_moments import braking_line
from regents_cosim.reports.drawing.pictured_case import PicturedCase
from regents_cosim.reports.drawing.texts.notes import mark_words
from regents_cosim.reports.page.case import PageCase, PageDrive
from regents_cosim.reports.page.crash_groups import NEEDS, ReportedCrash, need_of, needed_work
from regents_cosim.reports.page.html import TERMS, html_page
from regents_cosim.reports.page.map import PageMaps
from regents_cosim.reports.page.packing import CM, differences, stretches
from regents_cosim.reports.report import judge_rest, motion_sheet, report_of
from regents_cosim.scenario.judgement import EDITION, Fault, Flaw, Holds, Judgement, ReferenceDrive
from regents_cosim.verdicts.words import crash_words

DOCS = Path(__file__).parents[2] / "docs"
QUICKSTART = shipped("scenarios") / "quickstart"
CASES = load_suite(QUICKSTART)
CRASHES = [case for case in CASES if case.collision]
HARMFUL = """<script>window.hurt = 1<img src=x onerror="window.hurt = 1"> & 'ünïcode' <!--"""


def unpacked(page: str, name: str):
    """What the browser finds in the script `name`."""
    found = re.search(f'<script id="{name}" type="text/plain">([^<]*)</script>', page)
    assert found is not None
    return json.loads(gzip.decompress(base64.b64decode(found[1])))


def rows_of(page: str):
    found = re.search(r'<script id="page" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return json.loads(found[1])["rows"]


def passing(case):
    """Tracks in which the ego drives as before the attack, far from everybody."""
    away = np.where(np.arange(len(case.agents))[:, None] == 0, 1000.0, 0.0)
    return replace(case.tracks, x=case.tracks.x + away, y=case.tracks.y + away)


def drive(case, hits=None, error=""):
    return DriveResult(case.id, case.provenance.file, hits, 3 if hits else None, score=1.0, completion=1.0, error=error)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=50))
def test_positions_come_back_within_half_a_centimetre(values):
    back = CM * np.cumsum(differences(np.array(values), CM))
    np.testing.assert_allclose(back, values, atol=0.5 * CM + 1e-6)


@given(st.lists(st.booleans(), max_size=30))
def test_stretches_hold_each_valid_step_once(valid):
    parts = stretches(np.array(valid, bool))
    assert [step for part in parts for step in part] == list(np.flatnonzero(valid))
    assert all((np.diff(part) == 1).all() for part in parts)
    assert all(b[0] - a[-1] > 1 for a, b in itertools.pairwise(parts))


@pytest.mark.slow
def test_the_page_carries_the_tracks_of_every_case():
    page = html_page(report_of(CASES, {}))
    maps = PageMaps()
    home = {case.id: maps.home(case) for case in CASES}
    for index, row in enumerate(rows_of(page)):
        case = next(case for case in CASES if case.id == row["id"])
        content, origin = unpacked(page, f"case-{index}"), home[case.id].origin
        for agent, spans in enumerate([content["runs"][0], *content["tracks"]]):
            steps = np.flatnonzero(case.tracks.valid[agent])
            found = np.hstack([np.cumsum(span[1:], axis=1) for span in spans])
            assert [step for span in spans for step in range(span[0], span[0] + len(span[1]))] == list(steps)
            expected = np.array([case.tracks.x[agent] - origin[0], case.tracks.y[agent] - origin[1]])[:, steps]
            np.testing.assert_allclose(0.01 * found[:2], expected, atol=0.00501)
            np.testing.assert_allclose(0.001 * found[3], case.tracks.speed[agent, steps], atol=0.000501)
            turn = 0.001 * found[2] - case.tracks.yaw[agent, steps]
            np.testing.assert_allclose(np.sin(turn), 0.0, atol=0.000501)


def test_the_gap_is_that_of_the_exact_boxes():
    case = CRASHES[0]
    page = html_page(report_of([case], {}))
    [[first, values]] = unpacked(page, "case-0")["gaps"]["runs"][0]
    adversary = case.adversary
    ego, other = (Boxes(*(np.broadcast_to(v, case.tracks.x.shape)[i] for v in case.boxes)) for i in (0, adversary))
    expected = np.asarray(distance(ego, other))[first : first + len(values)]
    np.testing.assert_allclose(0.01 * np.cumsum(values), expected, atol=0.00501)
    assert np.cumsum(values)[case.collision.step - first] == 0


def test_the_lights_of_the_page_are_those_of_the_case():
    case = next(case for case in CASES if case.signals)
    page = html_page(report_of([case], {}))
    shown = {name: dict(changes) for name, changes in unpacked(page, "case-0")["signals"].items()}
    assert shown == {signal.id: dict(signal.changes) for signal in case.signals}
    bars = {(bar["signal"], bar["link"]) for bar in unpacked(page, "map-0")["bars"]}
    links = {(link.signal, link.link) for link in case.road.connections if link.signal}
    assert bars
    assert bars <= links


@pytest.mark.slow
def test_the_verdict_of_the_page_is_that_of_the_case():
    for row in rows_of(html_page(report_of(CASES, {}))):
        case = next(case for case in CASES if case.id == row["id"])
        hit = case.collision
        [ending] = row["endings"]
        assert (ending is None) == (hit is None)
        if ending and hit:
            assert (ending["agent"], ending["step"]) == (hit.agent, hit.step)
            assert ending["impact"] == pytest.approx(hit.relative_speed, abs=0.006)


@pytest.mark.slow
def test_a_map_keeps_its_shape_around_the_cases():
    for one in report_of(CASES, {}).maps:
        content = one.content()
        rings = [0.01 * np.cumsum(ring, axis=1).T + one.origin for ring in content["rings"]]
        drawn = shapely.Polygon()
        for ring in rings:
            drawn = drawn.symmetric_difference(shapely.make_valid(shapely.Polygon(ring)))  # even-odd, as the page fills
        real = shapely.intersection(one.road.drivable, one.area)
        assert drawn.buffer(0.06).contains(real)
        assert real.buffer(0.06).contains(drawn)
        assert content["dashed"] or content["solid"]


@pytest.mark.slow
def test_cases_on_one_map_carry_it_once():
    page = html_page(report_of(CASES, {}))
    roads = {id(case.road) for case in CASES}
    assert len(re.findall(r'<script id="map-', page)) == len(roads)


def test_ids_of_any_letters_do_no_harm():
    case_id = HARMFUL.replace("/", "|").replace("\u2028", "")  # what may name a folder
    case = replace(CRASHES[0], id=case_id)
    page = html_page(report_of([case], {HARMFUL: [(drive(case, error=HARMFUL), None)]}))
    assert "<img" not in page
    assert "<script>window" not in page
    [row] = rows_of(page)
    assert (row["id"], row["errors"]) == (case_id, [HARMFUL])


def test_what_cannot_be_seen_is_shown():
    error = "first \u202e\x1b[2J\nsecond </script> \u2028"
    page = html_page(report_of([CRASHES[0]], {"a\u2066": [(drive(CRASHES[0], error=error), None)]}))
    [row] = rows_of(page)
    assert row["errors"] == ["first \\u202e\\x1b[2J\nsecond </script> \\u2028"]
    assert not set(page) & set("\u202e\x1b\u2028\u2066")


@pytest.mark.slow
def test_no_command_of_a_file_is_offered_to_be_run():
    """Who attacked is a name in the case, and `exec:` or a path would run what it says."""
    for planner in ("exec:touch PWNED", "evil.py:Planner", "evil.module:Planner"):
        case = replace(CRASHES[0], attack=replace(CRASHES[0].attack, planner=planner))
        commands = unpacked(html_page(report_of([case], {}, QUICKSTART)), "case-0")["commands"]
        assert all(planner not in line for _, line in commands)
        driven = {planner: [(drive(case), case.tracks)]}  # given on the command line
        [first, *_] = unpacked(html_page(report_of([case], driven, QUICKSTART)), "case-0")["commands"]
        assert shlex.split(first[1])[-1] == planner


def test_the_policy_names_the_script_and_the_style_of_the_page():
    page = html_page(report_of([CRASHES[0]], {}))
    [policy] = re.findall(r'Content-Security-Policy" content="([^"]*)"', page)
    policy = html.unescape(policy)
    assert "unsafe" not in policy
    for tag in ("script", "style"):
        [text] = re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy
    assert " style=" not in page


def test_the_summary_counts_every_crash_once():
    found = [("adversary", True), ("ego", False), ("nobody", True), ("ego", True), ("ego", False)]
    cases = [judged_as(case, *of) for case, of in zip(CRASHES, found, strict=False)]
    crashes = [case.crash for case in report_of(cases, {}).worst_first]
    work = needed_work([crash for crash in crashes if crash])
    found = [group for one in work for group in one.groups]
    assert [one.need for one in work] == ["rest"]  # the law is not judged: none is known to be telling
    assert sorted(name for group in found for name in group.cases) == sorted(case.id for case in cases)
    assert [group.crashes for group in found] == [len(group.cases) for group in found]
    assert "planner at fault" in found[0].why
    assert found[0].first == cases[3].id
    assert {group.why.partition(",")[0] for group in found} == {
        "planner at fault", "other road user at fault", "fault unclear"
    }  # fmt: skip


def test_a_new_drive_has_a_verdict_of_its_own():
    case = CRASHES[0]
    made = report_of([case], {"mine": [(judged(case, "mine", case.tracks), case.tracks)]})
    expected = next(iter(judge_rest([case]))).judgement
    assert expected
    assert expected.fault
    [row] = rows_of(html_page(made))
    assert (row["rule"], row["clean"]) == (expected.fault.rule, expected.clean)


def judged_as(case, at_fault, avoids, flaws=()):
    drives = (ReferenceDrive("careful", avoids, 1.0, 2.1),)
    judgement = Judgement(flaws, Fault(at_fault, "rule", "reason"), drivers=drives, edition=EDITION)
    return replace(case, judgement=judgement, evasion=ego_alone(case.tracks) if avoids else None)


def ego_alone(tracks):
    return replace(tracks, **{name: getattr(tracks, name)[:1] for name in ("x", "y", "yaw", "speed", "valid", "z")},
                   accel=None, curvature=None)  # fmt: skip


def test_the_worst_come_first():
    crashed, passed = CRASHES[0], passing(CRASHES[0])
    cases = [replace(crashed, id=name) for name in ("fixed", "both", "neither", "broken", "failed")]
    hits = crashed.agents[1].id
    end = {"fixed": (1, 0), "both": (1, 1), "neither": (0, 0), "broken": (0, 1), "failed": (0, None)}
    driven = {
        name: [
            (drive(case, error="it stopped"), None)
            if end[case.id][k] is None
            else (drive(case, hits if end[case.id][k] else None), crashed.tracks if end[case.id][k] else passed)
            for case in cases
        ]
        for k, name in enumerate(("before", "after"))
    }
    rows = rows_of(html_page(report_of(cases, driven)))
    assert [row["id"] for row in rows] == ["failed", "broken", "both", "neither", "fixed"]
    assert [row["change"] for row in rows] == ["broken", "broken", "unchanged", "unchanged", "fixed"]


def end(need):
    """One that leaves that to be done."""
    if need is None:
        return CaseEnd(crashed=False)
    if need == "failed":
        return CaseEnd(crashed=False, failed="it raised")
    fault = "ego" if need == "own_fault" else "adversary"
    tells = need in ("own_fault", "telling")
    flaws = () if tells else (Flaw.FROM_BEHIND,)
    verdict = CrashVerdict(fault, "rule", clean=tells, telling=tells, flawless=need == "own_fault", flaws=flaws)
    if need == "ordinary":
        verdict = replace(verdict, at_fault="ego")
    return CaseEnd(crashed=True, ordinary=need == "ordinary", verdict=verdict)


@given(st.permutations([*NEEDS, None]))
def test_what_to_do_first_is_in_one_order(needs):
    """Failures, crashes that need no attack, telling ones by the planner's fault, the other telling ones, the rest."""
    assert [need_of(end(need)) for need in needs] == needs
    crashes = [ReportedCrash(f"{need}", "T-bone", end(need), broken=False) for need in needs if need]
    work = needed_work(crashes)
    assert [one.need for one in work] == ["failed", "ordinary", "own_fault", "telling", "rest"]
    assert all(one.todo.endswith(".") and one.crashes == 1 for one in work)
    assert [one.flawless for one in work] == [0, 0, 1, 0, 0]


def test_who_is_run_into_from_behind_in_ordinary_traffic_has_little_to_mend():
    """Who replays a track does not brake for the ego: that is the planner's matter only where it is to blame."""
    behind = CrashVerdict("adversary", "rear_end", clean=False, flaws=(Flaw.UNATTRIBUTED, Flaw.REAR_ENDS_EGO))
    assert need_of(CaseEnd(crashed=True, ordinary=True, verdict=behind)) == "rest"
    assert need_of(CaseEnd(crashed=True, ordinary=True, verdict=replace(behind, at_fault="ego"))) == "ordinary"
    assert need_of(CaseEnd(crashed=True, ordinary=True)) == "ordinary"


@pytest.mark.parametrize(
    ("first", "second", "change"),
    [
        ("telling", "rest", "better"),
        ("own_fault", "rest", "better"),
        ("rest", "telling", "worse"),
        ("rest", "failed", "worse"),
        ("rest", None, "fixed"),
        (None, "rest", "broken"),
        ("telling", "telling", "unchanged"),
        (None, None, "unchanged"),
    ],
)
def test_a_crash_that_tells_nothing_any_more_is_better_than_one_that_does(first, second, change):
    case = CRASHES[0]
    runs = tuple(PageDrive(name, case.tracks, end=end(need)) for name, need in (("old", first), ("new", second)))
    assert PageCase(case, runs).change == change


def test_a_crash_is_told_and_marked_on_the_page_as_in_its_picture():
    case = CRASHES[0]
    tracks, hit = case.tracks, case.collision
    driven, home = PageDrive("idm", tracks, end=CaseEnd(crashed=True)), PageMaps().home(case)
    content = PageCase(case, (driven,)).content(home, None)
    assert content["stories"] == [crash_words(case.agents, tracks, hit)]
    assert content["braking"] == [braking_line(case, tracks, hit)]
    scene = PicturedCase.of(case)
    assert content["marks"]
    assert [(m["kind"], m["step"], m["words"]) for m in content["marks"]] == [
        (m.kind, m.step, mark_words(scene, m)) for m in scene.marks
    ]
    others = PageCase(case, (driven,)).content(home, None, driven=True)
    assert others["braking"] == [braking_line(case, tracks, hit, with_careful=False)]
    assert others["marks"] == [], "what the attack's own drive shows says nothing of another drive"


def test_the_page_says_whether_a_crash_holds_where_that_was_tried():
    case = judged_as(CRASHES[0], "ego", True)
    noted = replace(case, judgement=replace(case.judgement, holds=Holds(replayed=True, reactive=True, sumo=False)))
    old, new = (
        dict(PageCase(one, (PageDrive("idm", one.tracks),)).content(PageMaps().home(one), None)["judgement"])
        for one in (case, noted)
    )
    assert "Holds" not in old
    assert new["Holds"].endswith("not with the others driven by SUMO: the ego hits one of them first")


def test_the_words_of_the_page_are_explained_where_the_documentation_explains_them():
    told = (DOCS / "glossary.md").read_text().lower()
    ours = {"least ttc", "at", "impact", "gap", "decision time", "broken", "worse", "better", "fixed", "unchanged"}
    ours |= {"at fault", "preventable by", "crashes without an attack", "collision rate"}
    assert [word for word in TERMS if word not in ours and word not in told] == []


@pytest.mark.slow
def test_scores_count_what_the_cases_hold():
    cases = [judged_as(case, "ego", k % 2 == 0, () if k else (Flaw.OFF_ROAD,)) for k, case in enumerate(CRASHES)]
    others = [case for case in CASES if case not in CRASHES]
    scores = {score.label: score for score in report_of([*cases, *others], {}).scores}
    assert scores["Crashes"].detail == f"{len(CRASHES)} of {len(CASES)} cases"
    assert scores["Clean crashes"].detail == f"{len(CRASHES) - 1} of {len(CASES)} cases"
    assert scores["Preventable"].detail == f"{(len(CRASHES) + 1) // 2} of {len(CRASHES)} crashes"
    low, high = scores["Crashes"].interval or (0.0, 0.0)
    assert low < len(CRASHES) / len(CASES) < high


def test_the_motion_sheet_has_the_middle_nine_tenths_of_the_motion():
    case = CRASHES[0]
    agent = case.index(case.collision.agent)
    sheet = motion_sheet(case)
    for name, tracks in (("after", case.tracks), ("before", case.recorded_tracks)):
        accel = motion(tracks, agent, case.dt, case.collision.step + 1).accel
        assert getattr(sheet[0], name) == pytest.approx(np.percentile(accel, [5, 95]), abs=0.006)


@pytest.mark.parametrize(("braking", "beyond"), [(ACCEL_LIMIT, 0.0), (1.1 * MOST_ACCEL_M_S2, 100.0)])
def test_beyond_the_limit_is_what_tyres_cannot_hold_and_not_full_braking(braking, beyond):
    case = CRASHES[0]
    agent = case.adversary
    speed = 200.0 - braking * case.dt * np.arange(case.tracks.steps)
    accel, lateral, *_ = motion_sheet(moving(case, agent, speed=speed))
    assert accel.beyond_percent == beyond
    assert accel.limit == lateral.limit == round(MOST_ACCEL_M_S2, 1)


def test_an_adversary_that_meets_the_ego_at_once_has_no_motion_sheet():
    case = CRASHES[0]
    attack = replace(case.attack, collision=replace(case.collision, step=1))
    assert motion_sheet(replace(case, attack=attack)) == ()


def test_recorded_traffic_has_a_report_too():
    recorded = [case.before_attack() for case in CASES[:2]]
    made = report_of(recorded, {})
    assert made.title == "Recorded traffic"
    assert [row["endings"] for row in rows_of(html_page(made))] == [[None], [None]]


def test_a_case_whose_planner_failed_has_no_ego():
    case = CRASHES[0]
    page_case = PageCase(case, (PageDrive("mine", None, "it stopped"),))
    content = page_case.content(PageMaps().home(case), None)
    assert (content["runs"], content["contacts"], content["gaps"]["runs"]) == ([[]], [None], [[]])


@pytest.mark.slow
def test_three_hundred_cases_stay_small():
    assert 300 / len(CASES) * len(html_page(report_of(CASES, {}))) < 20e6


@pytest.mark.slow
@pytest.mark.parametrize("agent", [0, 1])
def test_one_position_far_away_takes_little_memory(agent):
    case = CRASHES[0]
    x = case.tracks.x.copy()
    x[agent, 5] += 9e4
    case = replace(case, tracks=replace(case.tracks, x=x, accel=None, curvature=None))
    tracemalloc.start()
    page = html_page(report_of([case], {}))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 50e6
    assert len(page) < 1e6


@pytest.mark.slow
def test_the_report_in_python(tmp_path):
    report(QUICKSTART, tmp_path / "new" / "report.html")
    page = (tmp_path / "new" / "report.html").read_text("utf-8")
    twin = json.loads((tmp_path / "new" / "report.report.json").read_text("utf-8"))
    assert page.startswith("<!doctype html>")
    assert twin["schema"] == 3
    assert {row["id"] for row in twin["cases"]} == {case.id for case in CASES}
    [name] = {row["id"] for row in twin["cases"][:1]}
    watch = dict(unpacked(page, "case-0")["commands"])["Watch it in SUMO"]
    assert shlex.split(watch)[:3] == ["regents", "replay", str(QUICKSTART / name)]


@pytest.mark.parametrize(
    ("cases", "name", "planners", "said"),
    [
        ([], "r.html", (), "no cases"),
        ([CASES[0], CASES[0]], "r.html", (), "occurs 2 times"),
        ("missing", "r.html", (), "missing"),
        (CASES, "r.pdf", (), "ends in .html"),
        (CASES, "", (), "ends in .html"),
        (CASES, "r.html", ("idm", "idm"), "two different"),
        (CASES, "r.html", ("nobody",), "nobody"),
    ],
)
def test_bad_input_leaves_nothing(cases, name, planners, said, tmp_path):
    with pytest.raises(RegentsError, match=said):
        report(tmp_path / cases if isinstance(cases, str) else cases, tmp_path / name, planners)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_place_where_nothing_can_be_written(tmp_path):
    (tmp_path / "file").touch()
    done = regents("report", QUICKSTART, "-o", tmp_path / "file" / "report.html", code=2)
    assert "cannot write" in done.stderr
    assert (tmp_path / "file").read_bytes() == b""


@pytest.mark.slow
def test_the_command(tmp_path):
    case = QUICKSTART / CRASHES[0].id
    done = regents("report", case, "-o", tmp_path / "report.html", "--planner", "constant_velocity", "--json", code=0)
    scores = {row["score"]: row for row in json.loads(done.stdout)}
    twin = json.loads((tmp_path / "report.report.json").read_text("utf-8"))
    assert twin["drivers"] == ["constant_velocity"]
    [row] = twin["cases"]
    assert scores["Collision rate"]["value"] == ("0 %" if row["endings"] == [None] else "100 %")
    assert scores["Collision rate"]["detail"].endswith(" of 1 case")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report.html", "report.report.json"]


def test_the_report_judges_the_crashes_that_nobody_has_judged():
    for before, after in zip(CASES, judge_rest(CASES), strict=True):
        assert (after.judgement is None) == (before not in CRASHES)
        again = next(iter(judge_rest([after])))
        assert again is after
