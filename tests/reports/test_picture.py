import io
import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from scenes import DT, crash, moved, scene, straight_road
from shipped_cases import QUICKSTART

from regents_cosim.cases.suite import load_suite
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.drives.crash_verdict import as_driven
from regents_cosim.geometry.boxes import Boxes, corners
from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.reports.crash_moments import braking_line
from regents_cosim.reports.drawing.camera import View, centred, fit_latest
from regents_cosim.reports.drawing.canvas import Canvas, dashes, shorten, text_width
from regents_cosim.reports.drawing.film import Backdrop, frame_steps, gif_bytes, shoot
from regents_cosim.reports.drawing.palette import (
    ADVERSARY,
    BURST,
    EGO,
    EVASION,
    LAND,
    OTHER,
    PANEL,
    ROAD,
    SIGNAL_GREEN,
    SIGNAL_RED,
    gif_palette,
)
from regents_cosim.reports.drawing.pictured_case import PicturedCase, draw_ground, draw_moving, pose_at
from regents_cosim.reports.drawing.texts.caption import (
    HEADER_PX,
    caption_lines,
    describe,
    draw_header,
    header_height,
    plain,
    story,
    story_lines,
)
from regents_cosim.reports.drawing.texts.labels import Label, PlacedLabel, place
from regents_cosim.reports.drawing.texts.legend import legend_rows
from regents_cosim.reports.drawing.texts.notes import still_notes
from regents_cosim.reports.picture import GIF_SIZE, STILL_SIZE, animate, animate_pair, draw_still, footer_height
from regents_cosim.scenario.collisions import relative_speed
from regents_cosim.scenario.scenario import Scenario, Signal
from regents_cosim.verdicts.careful.evasion import evaded
from regents_cosim.verdicts.judge import judge
from regents_cosim.verdicts.words import braking_words, verdict_words

SHIFT_M = 3.2  # one lane
CRASHES = [case for case in load_suite(QUICKSTART) if case.collision]


def recorded(**changes) -> Scenario:
    """The ego, a car ahead in the next lane, and one behind that is of no matter."""
    return scene((0.0, 0.0, 10.0), (6.0, SHIFT_M, 9.0), (-20.0, 2 * SHIFT_M, 8.0), **changes)


def attacked(**changes) -> Scenario:
    """The same, where the car in the next lane moves over into the ego from step 20 on."""
    before = recorded(**changes)
    over = np.clip((np.arange(before.tracks.steps) - 20) / 30, 0.0, 1.0)
    case = crash(before, moved(before, 1, y=before.tracks.y[1] - SHIFT_M * over))
    collision = case.collision
    collision = replace(collision, relative_speed=relative_speed(case.tracks, 1, collision.step))
    return replace(case, attack=replace(case.attack, method="regents", iterations=120, collision=collision))


def close_to(image: Image.Image, colour: tuple[int, int, int], tolerance: int = 6) -> np.ndarray:
    """Where `image` shows `colour`, [row, column]."""
    return (np.abs(np.asarray(image.convert("RGB"), int) - colour) <= tolerance).all(axis=-1)


def instant(scenario: Scenario, view: View, step: int) -> Image.Image:
    shown = PicturedCase.of(scenario)
    canvas = draw_ground(shown, view, 2)
    draw_moving(shown, canvas, view, step)
    return canvas.finish()


def at(image: Image.Image, view: View, x: float, y: float) -> tuple[int, int, int]:
    column, row = view.pixels(np.array([x, y])).astype(int).tolist()
    pixel = image.getpixel((column, row))
    assert isinstance(pixel, tuple)
    return pixel


def near(a: tuple[int, int, int], b: tuple[int, int, int]) -> bool:
    return max(abs(x - y) for x, y in zip(a, b, strict=True)) <= 3


# --- stills -----------------------------------------------------------------------------------


def test_still_shows_the_collision(tmp_path):
    scenario = attacked()
    path = tmp_path / "case.png"
    draw_still(scenario, path)
    image = Image.open(path)
    assert image.format == "PNG"
    assert image.size == STILL_SIZE
    for colour in (EGO, ADVERSARY, OTHER, BURST, ROAD, LAND, PANEL):
        assert close_to(image, colour).sum() > 20, colour
    assert path.stat().st_size < 200_000
    assert [p.name for p in tmp_path.iterdir()] == ["case.png"]


def test_still_of_recorded_traffic_has_no_adversary_and_no_burst(tmp_path):
    path = tmp_path / "case.png"
    draw_still(recorded(), path)
    image = Image.open(path)
    assert close_to(image, EGO).sum() > 100
    assert not close_to(image, ADVERSARY).any()
    assert not close_to(image, BURST).any()


def test_agents_are_where_their_tracks_say():
    scenario = recorded()
    view = centred(np.array([40.0, 3.0]), 8.0, (1000, 300))
    image = instant(scenario, view, 40)
    tracks = scenario.tracks
    rear = [(float(x) - 1.2, float(y)) for x, y in zip(tracks.x[:, 40], tracks.y[:, 40], strict=True)]
    assert near(at(image, view, *rear[0]), EGO)
    assert near(at(image, view, *rear[1]), OTHER)
    assert near(at(image, view, *rear[2]), OTHER)
    there = close_to(image, EGO, 2)
    there[:, :450] = False  # the dots on its path
    rows, columns = np.nonzero(there)
    expected = view.pixels(np.array([[40.0 - 2.3, 0.9], [40.0 + 2.3, -0.9]]))
    found = np.array([[columns.min(), rows.min()], [columns.max() + 1, rows.max() + 1]])
    assert np.abs(found - expected).max() < 2.0  # the outline is of another colour
    assert near(at(image, view, 60.0, 30.0 - 8.0), LAND)
    assert near(at(image, view, 60.0, 1.0), ROAD)


def test_the_front_differs_from_the_rear():
    view = centred(np.array([0.0, 0.0]), 10.0, (200, 100))
    image = instant(recorded(), view, 0)
    assert near(at(image, view, -0.75, 0.0), EGO)
    assert not near(at(image, view, 0.75, 0.0), EGO)  # the windscreen


def test_the_mark_is_at_the_contact_point_from_the_collision_on():
    scenario = attacked()
    collision, shown = scenario.collision, PicturedCase.of(scenario)
    box = shapely.box(-2.3, -0.9, 2.3, 0.9)
    tracks, step = scenario.tracks, collision.step
    ego, other = (shapely.affinity.translate(box, tracks.x[i, step], tracks.y[i, step]) for i in (0, 1))
    expected = ego.intersection(other).centroid
    assert shown.contact_point is not None
    np.testing.assert_allclose(shown.contact_point, [expected.x, expected.y])
    view = centred(shown.contact_point, 8.0, (300, 200))
    assert not close_to(instant(scenario, view, step - 1), BURST).any()
    for later in (step, step + 8):
        rows, columns = np.nonzero(close_to(instant(scenario, view, later), BURST))
        assert abs(rows.mean() - 99.5) < 1.0
        assert abs(columns.mean() - 149.5) < 1.0


def test_agents_are_not_drawn_while_they_are_absent():
    valid = np.ones((3, 81), bool)
    valid[2, :50] = False
    plainly = recorded()
    tracks = plainly.tracks
    blank = {name: np.where(valid, getattr(tracks, name), 0.0) for name in ("x", "y", "yaw", "speed")}
    scenario = recorded(tracks=replace(tracks, valid=valid, **blank))
    view = centred(np.array([10.0, 3.0]), 6.0, (900, 200))
    for step, there in ((49, False), (50, True)):
        image = instant(scenario, view, step)
        assert near(at(image, view, -20.0 + 0.8 * step - 1.0, 2 * SHIFT_M), OTHER) == there
    origin = instant(scenario, view, 49)
    assert near(at(origin, view, 0.0, 0.4), ROAD)  # nothing lies where entries that are not valid point to


def test_the_track_before_the_attack_is_dashed():
    scenario = attacked()
    view = centred(np.array([50.0, 2.0]), 10.0, (600, 100))
    ground = draw_ground(PicturedCase.of(scenario), view, 2).finish()
    bare = draw_ground(PicturedCase.of(scenario.before_attack()), view, 2).finish()
    row = int(view.pixels(np.array([0.0, SHIFT_M]))[1])
    strip = np.asarray(ground)[row - 1 : row + 1].astype(int), np.asarray(bare)[row - 1 : row + 1].astype(int)
    changed = np.abs(strip[0] - strip[1]).max(axis=(0, 2)) > 40
    assert 0.3 < changed.mean() < 0.8
    assert np.diff(changed.astype(int)).clip(min=0).sum() > 20


def test_an_evasion_is_drawn_and_named(tmp_path):
    scenario = next(case for case in CRASHES if case.evasion is not None)
    draw_still(scenario, tmp_path / "case.png")
    assert close_to(Image.open(tmp_path / "case.png"), EVASION, 12).sum() > 100
    drive = scenario.judgement and scenario.judgement.careful
    assert drive is not None
    avoided = PicturedCase.of(evaded(scenario))
    assert "a careful driver evades" in describe(avoided)
    assert story(avoided) == (
        f"A careful driver {braking_words(drive.shift_m)} from {drive.acts_s:.1f} s and avoids the collision."
    )


def test_a_story_says_what_happens_who_breaks_which_rule_and_what_prevents_it():
    scenario = judge(attacked())
    collision, said = scenario.collision, story(PicturedCase.of(scenario))
    ego, other = (3.6 * scenario.tracks.speed[i, collision.step] for i in (0, 1))
    assert said.startswith(
        f"At {collision.time_s:.1f} s the ego ({ego:.0f} km/h) and the adversary ({other:.0f} km/h) touch side by side."
    )
    assert scenario.judgement is not None
    assert verdict_words(scenario.judgement) in said
    assert story(PicturedCase.of(recorded())) == ""
    for width in (GIF_SIZE[0], STILL_SIZE[0]):
        lines = story_lines(PicturedCase.of(scenario), width)
        assert " ".join(lines) == plain(f"{said} {braking_line(scenario, scenario.tracks, collision)}")
        assert not any(line.endswith(tuple("0123456789")) for line in lines), "a number keeps its unit"


# --- what a reader needs to understand a picture without its makers ---------------------------


def legend_of(scenario: Scenario, width: int = 2000) -> set[str]:
    return {entry.words for row in legend_rows(PicturedCase.of(scenario), width) for entry in row}


def test_the_legend_names_every_mark_and_none_that_is_not_drawn():
    always = {"ego", "other traffic", "path, a dot each second"}
    assert legend_of(recorded()) == always
    assert legend_of(signalled()) == always | {"traffic light"}
    crash = always | {"adversary", "without the attack", "collision"}
    assert legend_of(attacked()) == crash
    scenario = judge(attacked())
    assert any(mark.kind == "breaks_rule" for mark in PicturedCase.of(scenario).marks)
    assert legend_of(scenario) == crash | {"breaks a rule"}
    assert any("careful driver" in legend_of(case) for case in CRASHES)
    rows = legend_rows(PicturedCase.of(scenario), 500)
    assert len(rows) > 1
    assert all(sum(entry.width for entry in row) < 520 for row in rows)


def notes_of(scenario: Scenario) -> tuple[PicturedCase, View, list[PlacedLabel]]:
    scene = PicturedCase.of(scenario)
    step = scene.shown_step
    view = fit_latest(scene.main_points()[: step + 1], (1200, 640), 4.5)
    return scene, view, still_notes(scene, view, step, [])


def _breaks_a_rule(case: Scenario) -> bool:
    return {"breaks_rule", "evades"} <= {mark.kind for mark in PicturedCase.of(case).marks}


def _shows_where_it_would_be(case: Scenario) -> bool:
    """Whether the adversary of the log is in the picture of the crash."""
    scene, view, _ = notes_of(case)
    there = [view.pixels(np.array(pose[:2])) for index, pose, _ in scene.ghosts(scene.shown_step) if index]
    return any(0 < x < view.width and 0 < y < view.height for x, y in there)


def test_a_still_has_speeds_times_and_where_a_careful_driver_brakes():
    crashes = (case for case in load_suite(QUICKSTART.parent / "standard") if case.collision)
    scenario = next(case for case in crashes if _breaks_a_rule(case) and _shows_where_it_would_be(case))
    scene, view, notes = notes_of(scenario)
    step, onset, speed = scene.shown_step, scenario.evades_from, scenario.tracks.speed
    assert onset is not None
    words = {note.label.words: note for note in notes}
    for index, name in zip(sorted(scene.main), ("ego", "adversary"), strict=True):
        assert f"{name} {3.6 * speed[index, step]:.0f} km/h" in words
    braking = words[f"a careful driver brakes from here, {scenario.judgement.evades_s:.1f} s"]
    place = view.pixels(np.array([scenario.tracks.x[0, onset], scenario.tracks.y[0, onset]]))
    np.testing.assert_allclose(braking.label.at, place)
    assert f"adversary without the attack, {step * DT:.1f} s" in words
    assert any(said.startswith(f"careful driver at {step * DT:.1f} s: ") for said in words)
    assert any(re.fullmatch(r"\d s, \d+ km/h", said) for said in words)
    careful = next(drive for drive in scenario.judgement.drivers if drive.driver == "careful")
    assert f"{careful.perceives_s:.1f} s: a careful driver sees it coming" in words
    broken = [mark for mark in scene.marks if mark.kind == "breaks_rule"]
    assert broken
    for mark in broken:
        assert any(said.startswith(f"{mark.step * DT:.1f} s: ") for said in words)


def test_an_ego_that_stands_is_drawn():
    made = attacked()
    still = {name: np.concatenate([np.repeat(getattr(made.tracks, name)[:1, :1], made.tracks.steps, 1),
                                   getattr(made.tracks, name)[1:]]) for name in ("x", "y", "yaw")}  # fmt: skip
    assert notes_of(replace(made, tracks=replace(made.tracks, **still)))[2]


def test_texts_lie_inside_the_picture_and_on_nothing_else():
    scene, view, notes = notes_of(judge(attacked()))
    boxes = [shapely.box(*note.box) for note in notes]
    frame = shapely.box(0, 0, view.width, view.height)
    assert all(box.within(frame) for box in boxes)
    for k, box in enumerate(boxes):
        assert not any(box.intersects(other) for other in boxes[k + 1 :])
    tracks, agents = scene.scenario.tracks, scene.scenario.agents
    for index in scene.main:
        body = corners(Boxes(*pose_at(tracks, index, scene.shown_step), agents[index].length, agents[index].width))
        assert not any(shapely.Polygon(view.pixels(np.asarray(body))).intersects(box) for box in boxes)


@given(st.lists(st.tuples(st.floats(0, 400), st.floats(0, 300)), min_size=1, max_size=12))
@settings(max_examples=20)
def test_texts_keep_apart_wherever_their_places_are(places):
    labels = [Label(place, f"{number} s, 50 km/h", EGO) for number, place in enumerate(places)]
    found = place(labels, (400, 300), [(150.0, 100.0, 250.0, 200.0)], np.zeros((0, 2)))
    boxes = [shapely.box(*one.box) for one in found] + [shapely.box(150, 100, 250, 200)]
    assert shapely.union_all(boxes).area == pytest.approx(sum(box.area for box in boxes))
    assert all(box.within(shapely.box(0, 0, 400, 300)) for box in boxes)


def test_a_line_shows_who_has_to_give_way():
    """At the end of a lane that the one leaves who does not give way."""
    failed = [
        (case, who)
        for case in CRASHES
        for who, offences in (("ego", case.judgement.law.ego), ("adversary", case.judgement.law.adversary))
        if any(one.name == "gives_no_way" for one in offences)
    ]
    assert failed
    case, who = failed[0]
    scene = PicturedCase.of(case)
    (line,) = (mark for mark in scene.marks if mark.kind == "gives_way")
    assert ("adversary" if line.agent else "ego") == who
    back = 1.2 * bool(case.signals) * np.array([np.cos(line.pose[2]), np.sin(line.pose[2])])  # the lights are there
    end = np.array(line.pose[:2]) + back
    assert min(np.hypot(*(lane.centre[-1] - end)) for lane in case.road.lanes if not lane.junction) < 1e-6
    view = centred(end, 11.0, (300, 300))
    canvas = draw_ground(scene, view, 2)
    draw_moving(scene, canvas, view, 0)
    assert close_to(canvas.finish(), scene.colour(line.agent), 30).sum() > 30
    assert any(entry.words == "give way" for row in legend_rows(scene, 2000) for entry in row)


def signalled() -> Scenario:
    """One lane with two ways on, red then green; a second lane without a light."""
    lanes = (
        Lane("in", np.array([[-100.0, 0.0], [30.0, 0.0]]), 3.2, 14.0, left="free"),
        Lane("free", np.array([[-100.0, 3.2], [30.0, 3.2]]), 3.2, 14.0, right="in"),
        Lane("ahead", np.array([[30.0, 0.0], [80.0, 0.0]]), 3.2, 14.0, junction=True),
        Lane("turn", np.array([[30.0, 0.0], [60.0, -10.0]]), 3.2, 14.0, junction=True),
    )
    links = (
        Connection("in", "turn", "light", 0),
        Connection("in", "ahead", "light", 1),
        Connection("free", "ahead"),
        Connection("free", "turn", "unknown", 0),
    )
    road = RoadMap(lanes, links, shapely.box(-100.0, -12.0, 80.0, 5.0))
    return scene((0.0, 0.0, 2.0), road=road, signals=(Signal("light", ((0, "rG"), (40, "Gr"))),))


def test_stop_bars_show_the_lights_of_the_step_from_the_right():
    view = centred(np.array([30.0, 0.0]), 12.0, (240, 120))
    for step, right, left in ((39, SIGNAL_RED, SIGNAL_GREEN), (40, SIGNAL_GREEN, SIGNAL_RED)):
        image = instant(signalled(), view, step)
        assert near(at(image, view, 29.6, -0.7), right)
        assert near(at(image, view, 29.6, 0.7), left)
        assert near(at(image, view, 29.6, 3.2), ROAD)


def test_islands_in_holes_and_several_parts_are_drawn():
    ring = shapely.box(-50, -50, 50, 50) - shapely.box(-20, -20, 20, 20)
    area = shapely.union_all([ring, shapely.box(-5, -5, 5, 5)])
    road = RoadMap(straight_road().lanes, (), area)
    view = centred(np.array([0.0, 0.0]), 4.0, (300, 300))
    image = draw_ground(PicturedCase.of(recorded(road=road)), view, 1).finish()
    assert near(at(image, view, -30.0, -30.0), ROAD)
    assert near(at(image, view, -12.0, -12.0), LAND)
    assert near(at(image, view, -3.0, -3.5), ROAD)


# --- animations -------------------------------------------------------------------------------


@pytest.mark.slow
def test_animation_stops_one_second_after_the_collision(tmp_path):
    scenario = attacked()
    path = tmp_path / "case.gif"
    animate(scenario, path)
    frames = scenario.collision.step + 11
    with Image.open(path) as image:
        assert image.format == "GIF"
        assert image.width == 900
        assert 300 <= image.height <= 600
        assert image.n_frames == frames
        assert image.info["loop"] == 0
        durations = []
        for index in range(frames):
            image.seek(index)
            durations.append(image.info["duration"])
        assert durations == [100] * (frames - 1) + [1500]
        assert close_to(image, BURST).sum() > 30
        assert close_to(image, ADVERSARY, 12).sum() > 30
        image.seek(frames - 12)  # one step before the collision: only the legend has a star
        assert not close_to(image, BURST)[: image.height - 40].any()
    assert path.stat().st_size < 1_500_000


def test_animation_of_recorded_traffic_runs_to_the_end(tmp_path):
    path = tmp_path / "case.gif"
    scenario = recorded(steps=31)
    animate(scenario, path)
    view = shoot(
        PicturedCase.of(scenario).main_points(),
        DT,
        (900, 600 - HEADER_PX - footer_height(PicturedCase.of(scenario), 900)),
        320,
    )[0]
    with Image.open(path) as image:
        assert image.n_frames == 31
        for step in (0, 12, 30):
            image.seek(step)
            column, row = view.pixels(np.array([float(scenario.tracks.x[0, step]) - 1.0, 0.0]))
            pixel = image.convert("RGB").getpixel((int(column), int(row) + HEADER_PX))
            assert isinstance(pixel, tuple)
            assert max(abs(x - y) for x, y in zip(pixel, EGO, strict=True)) <= 8


def test_what_is_read_from_the_file_is_what_was_drawn():
    views = [centred(np.array([x, 3.0]), 6.0, (300, 120)) for x in (20.0, 20.0, 26.0)]
    frames = [instant(attacked(), view, step) for view, step in zip(views, (10, 11, 30), strict=True)]
    with Image.open(io.BytesIO(gif_bytes(iter(frames), DT))) as image:
        for index, frame in enumerate(frames):
            image.seek(index)
            expected = frame.quantize(palette=gif_palette(), dither=Image.Dither.NONE).convert("RGB")
            assert np.array_equal(np.asarray(image.convert("RGB")), np.asarray(expected))


def test_a_long_way_is_followed(tmp_path):
    fast = scene((-150.0, 0.0, 35.0), (-120.0, SHIFT_M, 35.0))
    size = (900, 490)
    views = shoot(PicturedCase.of(fast).main_points(), DT, size, 320)
    assert len({view.left for view in views}) > 40
    for step, view in enumerate(views):
        column, row = view.pixels(np.array([fast.tracks.x[0, step], fast.tracks.y[0, step]]))
        assert 0.1 * size[0] < column < 0.9 * size[0]
        assert 0.2 * size[1] < row < 0.8 * size[1]
    ground = Backdrop(PicturedCase.of(fast), views[0], 1)
    for step in (0, 33, 80):
        whole = draw_ground(PicturedCase.of(fast), views[step], 1).finish()
        tiled = ground.under(views[step]).finish()
        differs = np.abs(np.asarray(whole, int) - np.asarray(tiled, int)).max(axis=-1) > 60
        assert differs.mean() < 0.002


@pytest.mark.slow
def test_pairs_are_laid_out_by_the_shape_of_the_scene(tmp_path):
    path = tmp_path / "pair.gif"
    wide = attacked()
    animate_pair(wide.before_attack(), wide, path)
    with Image.open(path) as image:
        frames = image.n_frames
        assert frames == wide.collision.step + 11
        assert image.width == 1000
        image.seek(frames - 1)
        burst = np.nonzero(close_to(image, BURST)[: image.height - 40])[0]
        assert len(burst)
        assert burst.min() > image.height / 2  # only the lower picture has a collision
        orange = np.nonzero(close_to(image, ADVERSARY, 12)[70 : image.height - 40])[0]
        assert orange.min() < image.height / 2 - 70 < orange.max()  # both show the adversary


def test_pairs_beside_each_other(tmp_path):
    path = tmp_path / "pair.gif"
    still = scene((0.0, 0.0, 1.0), (6.0, SHIFT_M, 1.0), steps=6)
    animate_pair(still, still, path)
    with Image.open(path) as image:
        assert image.size[0] == 1004
        ego = np.nonzero(close_to(image, EGO, 12)[70 : image.height - 40])[1]
        assert ego.min() < 500 < ego.max()


@pytest.mark.slow
def test_equal_scenarios_give_equal_bytes(tmp_path):
    names = ("a.png", "b.png", "a.gif", "b.gif")
    for name in names:
        (draw_still if name.endswith("png") else animate)(attacked(steps=41, name="case"), tmp_path / name)
    still, again, film, film_again = ((tmp_path / name).read_bytes() for name in names)
    assert still == again
    assert film == film_again


@pytest.mark.parametrize(("dt", "last", "expected"), [(0.1, 2, [0, 1, 2]), (0.04, 5, [0, 2, 4, 5]), (0.5, 1, [0, 1])])
def test_about_ten_frames_per_second(dt, last, expected):
    assert frame_steps(last, dt) == expected


@pytest.mark.parametrize("planner", ["idm", "company/planners/of_last_year.py:TheMostCarefulPlannerOfAll"])
@pytest.mark.parametrize("width", [GIF_SIZE[0], 1004, STILL_SIZE[0]])
def test_a_caption_is_said_as_a_whole(planner, width):
    case = judge(attacked())
    assert case.attack is not None
    shown = PicturedCase.of(replace(case, attack=replace(case.attack, planner=planner)))
    lines = caption_lines(shown, width)
    assert " ".join(lines) == plain(describe(shown))
    assert all(text_width(line, 13) <= width - 230 for line in lines)
    header = draw_header(shown, 0, width, 1).finish()
    assert header.size == (width, header_height(shown, width))
    assert header.height == HEADER_PX + 17 * (len(lines) - 1)


def test_a_path_that_cannot_be_written_is_a_clear_error(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(RegentsError, match="cannot write to .*choose another folder"):
        draw_still(recorded(steps=3), file / "case.png")
    with pytest.raises(RegentsError, match="cannot write to"):
        animate(recorded(steps=3), file / "case.gif")
    with pytest.raises(RegentsError, match=r"time steps of 0\.1 s and 0\.2 s"):
        animate_pair(recorded(), recorded(dt=0.2), tmp_path / "pair.gif")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_picture_makes_the_folder_that_it_is_to_lie_in(tmp_path):
    draw_still(recorded(steps=3), tmp_path / "pictures" / "case.png")
    assert [p.name for p in (tmp_path / "pictures").iterdir()] == ["case.png"]


# --- parts ------------------------------------------------------------------------------------


def test_views_turn_metres_into_pixels():
    view = centred(np.array([100.0, 50.0]), 5.0, (400, 200))
    assert view.bounds() == (60.0, 30.0, 140.0, 70.0)
    np.testing.assert_allclose(view.pixels(np.array([[60.0, 70.0], [140.0, 30.0]])), [[0, 0], [400, 200]])
    np.testing.assert_allclose(view.shifted(10, 5).pixels(np.array([62.0, 69.0])), [0.0, 0.0])


def test_too_long_ways_lose_their_beginning():
    points = np.stack([np.linspace(0.0, 2000.0, 81), np.zeros(81)], axis=-1)[:, None]
    points[3] = np.nan
    view = fit_latest(points, (1200, 700), 4.5)
    assert view.px_per_m >= 4.5
    assert view.bounds()[0] < 1950.0 < 2000.0 < view.bounds()[2]
    assert view.bounds()[0] > 1700.0


def test_dashes_keep_their_length_around_corners():
    line = np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0]])
    found = dashes(line, 3.0, 1.0)
    assert [len(dash) for dash in found] == [2, 3, 2]
    lengths = [np.hypot(*np.diff(dash, axis=0).T).sum() for dash in found]
    np.testing.assert_allclose(lengths, [3.0, 3.0, 2.0])


@given(st.lists(st.tuples(*[st.floats(-300, 300)] * 2), min_size=2, max_size=6))
@settings(max_examples=12)
def test_only_dashes_that_are_seen_are_cut_and_they_are_the_same(corners):
    line = np.array(corners)
    whole, seen = (Canvas.blank((80, 60), 1, LAND) for _ in range(2))
    for dash in dashes(line, 7.0, 5.0):
        whole.line(dash, EGO, 2.0)
    seen.dashed(line, EGO, 2.0, (7.0, 5.0))
    # Pillow rounds corners that lie outside in another way: a pixel at the border may differ
    assert (np.asarray(whole.image)[3:-3, 3:-3] != np.asarray(seen.image)[3:-3, 3:-3]).any(axis=-1).sum() <= 2


def test_a_line_to_the_end_of_the_world_takes_little_memory():
    canvas = Canvas.blank((80, 60), 1, LAND)
    tracemalloc.start()
    canvas.dashed(np.array([[-3e8, 30.0], [3e8, 30.0]]), EGO, 2.0, (7.0, 5.0))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert close_to(canvas.image, EGO).sum() > 80
    assert peak < 1e6


def test_long_titles_are_cut_in_the_middle():
    name = "a-very-long-name-of-a-case-" * 8 + "end"
    short = shorten(name, 18, 400)
    assert text_width(short, 18) <= 400
    assert short.startswith("a-very")
    assert short.endswith("end")
    assert shorten("short", 18, 400) == "short"


def test_titles_say_planner_method_kind_time_and_speed():
    scenario = attacked()
    words = describe(PicturedCase.of(scenario))
    collision = scenario.collision
    for part in (
        "idm",
        "regents",
        "side-swipe",
        f"{collision.time_s:.1f} s",
        f"{3.6 * collision.relative_speed:.0f} km/h",
    ):
        assert part in words
    assert "recorded traffic" in describe(PicturedCase.of(recorded()))
    assert plain("Straße Ü 7 · 漢") == "Strasse U 7 · ?"
    assert scenario.attack is not None
    missed = replace(scenario, attack=replace(scenario.attack, outcome="no_collision", collision=None))
    assert "no collision found" in describe(PicturedCase.of(missed))


def test_titles_say_how_the_drive_of_another_planner_ended():
    scenario = attacked()
    same = as_driven(scenario, "careful")
    assert describe(PicturedCase.of(same)).replace("careful", "idm") == describe(PicturedCase.of(scenario))
    assert scenario.log is not None
    safe = as_driven(replace(scenario, tracks=scenario.log), "careful")
    assert describe(PicturedCase.of(safe)) == "planner careful · attack regents · no collision found"
    assert PicturedCase.of(safe).contact_point is None


def test_canvas_boxes_may_be_empty():
    canvas = Canvas.blank((10, 10), 2, LAND)
    canvas.box(3, 3, 3, 8, EGO)
    assert not close_to(canvas.finish(), EGO).any()


def test_the_palette_of_animations_leaves_room_for_transparency():
    colours = gif_palette().getpalette()
    assert colours is not None
    assert len(colours) // 3 < 256
