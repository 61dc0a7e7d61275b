"""The raster against a slow one made with shapely, pixel by pixel."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from scenes import TIME, scene
from walkers import walked

from regents_cosim.cases.shipped import shipped
from regents_cosim.cases.suite import load_suite
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.separation import Box
from regents_cosim.mirror.world import scene_origin
from regents_cosim.planners.aim_bev.camera import PAPERS, PIXELS, Camera
from regents_cosim.planners.aim_bev.ground import draw_cells, stop_bars, to_ground
from regents_cosim.planners.aim_bev.observe import COLOURS, MARK_S, MARK_WIDTH_M, MOST, Surroundings, observe
from regents_cosim.planners.aim_bev.planner import in_view

RENDER = jax.jit(observe, static_argnums=4)
WIDE = Camera.reaching(38.4)
LAND, SURFACE, LANE, EDGE, RED, GREEN, AMBER, OTHER, MARK = range(9)
LIGHT = {"r": RED, "s": RED, "g": GREEN, "G": GREEN, "y": AMBER, "Y": AMBER, "u": AMBER}


def rectangle(x, y, yaw, front, rear, half_width):
    """The rectangle between `rear` and `front` metres ahead of a point."""
    along, across = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    corners = [(front, 1), (front, -1), (rear, -1), (rear, 1)]
    return shapely.Polygon([np.array([x, y]) + a * along + b * half_width * across for a, b in corners])


def layers(made, step, near, camera):
    """(what, area), from the ground up; lane lines `near` a point only."""
    road, tracks = made.road, made.tracks
    around = [lane for lane in road.lanes if shapely.LineString(lane.centre).distance(near) < camera.reach_m + 5.0]
    lines = [shapely.LineString(lane.centre) for lane in around if lane.junction]
    for lane in around:
        if not lane.junction:
            lines += [
                shapely.LineString(lane.centre).offset_curve(side * lane.width / 2, join_style="mitre")
                for side in (-1, 1)
            ]
    found = [(SURFACE, road.drivable)]
    found.append((LANE, shapely.union_all([line.buffer(camera.lane_line_m / 2, cap_style="flat") for line in lines])))
    found.append((EDGE, road.drivable.boundary.buffer(camera.edge_line_m / 2)))
    letters = {signal.id: signal.letters(step) for signal in made.signals}
    for lane in road.lanes:
        links = sorted({(link.signal, link.link) for link in road.exits[lane.id] if link.signal in letters})
        ahead = lane.centre[-1] - lane.centre[-2]
        yaw, share = np.arctan2(ahead[1], ahead[0]), 0.84 * lane.width / max(len(links), 1)
        for index, (signal, link) in enumerate(links):
            aside = (index + 0.5) * share - 0.42 * lane.width
            place = lane.centre[-1] + aside * np.array([-np.sin(yaw), np.cos(yaw)])
            if letters[signal][link] in LIGHT:
                found.append((LIGHT[letters[signal][link]], rectangle(*place, yaw, 0.0, -0.9, share / 2)))
    for what in (OTHER, MARK):
        for i in range(1, len(made.agents)):
            if tracks.valid[i, step]:
                length, width, pose = (
                    made.agents[i].length,
                    made.agents[i].width,
                    [v[i, step] for v in (tracks.x, tracks.y, tracks.yaw)],
                )
                front = length / 2 + (MARK_S * tracks.speed[i, step] if what == MARK else 0.0)
                rear, half = (0.0, MARK_WIDTH_M / 2) if what == MARK else (-length / 2, width / 2)
                found.append((what, rectangle(*pose, front, rear, half)))
    return found


def slow_raster(made, step, x, y, yaw, camera=PAPERS):
    offsets, reach = ((PIXELS - 1) / 2 - np.arange(PIXELS)) * camera.pixel_m, camera.reach_m
    ahead, left = np.meshgrid(offsets, offsets, indexing="ij")
    east = x + ahead * np.cos(yaw) - left * np.sin(yaw)
    north = y + ahead * np.sin(yaw) + left * np.cos(yaw)
    shown = np.zeros((PIXELS, PIXELS), int)
    for what, area in layers(made, step, shapely.Point(x, y), camera):
        near = shapely.clip_by_rect(area, x - reach, y - reach, x + reach, y + reach)
        if not near.is_empty:
            shapely.prepare(near)
            shown = np.where(shapely.contains_xy(near, east, north), what, shown)
    return COLOURS[shown]


class Eye:
    """Renders a scenario's views."""

    def __init__(self, made, around=None, camera=PAPERS):
        self.camera, tracks, self.origin = camera, made.tracks, scene_origin(made)
        track = np.stack([tracks.x[0], tracks.y[0]], axis=-1) if around is None else np.array([around])
        around_m = camera.reach_m + 5.0
        low, high = track.min(axis=0) - around_m, track.max(axis=0) + around_m
        self.ground = to_ground(draw_cells(made.road, low, high, camera), low, self.origin)
        self.bars, self.lights = stop_bars(made.road, made.signals, tracks.steps, self.origin)
        self.made = made

    def view(self, step):
        tracks, agents = self.made.tracks, self.made.agents[1:]
        x, y, yaw, speed = (v[1:, step] for v in (tracks.x, tracks.y, tracks.yaw, tracks.speed))
        size = (np.array([a.length / 2 for a in agents]), np.array([a.width / 2 for a in agents]))
        fields = (x - self.origin[0], y - self.origin[1], np.cos(yaw), np.sin(yaw), *size)
        box = Box(*(jnp.asarray(v, jnp.float32) for v in fields))
        return Surroundings(
            box, jnp.asarray(speed, jnp.float32), jnp.asarray(tracks.valid[1:, step]), self.lights[step]
        )

    def sees(self, step, x, y, yaw):
        values = (x - self.origin[0], y - self.origin[1], yaw, 0.0)
        ego = Motion(*map(jnp.float32, values))
        return np.asarray(RENDER(self.ground, self.bars, self.view(step), ego, self.camera))


CASES = {case.id.partition("-")[0]: case for case in load_suite(shipped("scenarios") / "quickstart")}


@pytest.mark.parametrize(
    ("name", "camera"), [("multilane", PAPERS), ("roundabout", PAPERS), ("signals", PAPERS), ("merge", WIDE)]
)
def test_it_shows_what_the_slow_raster_shows(name, camera):
    made, eye, rng = CASES[name], Eye(CASES[name], camera=camera), np.random.default_rng(0)
    for step in (0, 60):
        x, y, yaw = (v[0, step] for v in (made.tracks.x, made.tracks.y, made.tracks.yaw))
        pose = x + rng.uniform(-3, 3), y + rng.uniform(-3, 3), yaw + rng.uniform(-0.5, 0.5)
        same = (eye.sees(step, *pose) == slow_raster(made, step, *pose, camera)).all(axis=-1)
        assert same.mean() > 0.99


def test_people_are_shown_as_large_as_they_are():
    made = walked(scene((0, 0, 0), (80, 0, 0)), 1, 0 * TIME + 12.0, 1.4 * np.minimum(TIME, 5.0) - 3.0)
    for step, marks in ((20, 8), (70, 1)):
        seen = Eye(made).sees(step, 0.0, 0.0, 0.0)
        shown = {what: int((seen == COLOURS[what]).all(axis=-1).sum()) for what in (OTHER, MARK)}
        assert shown[OTHER] + shown[MARK] >= 6
        assert shown[MARK] >= marks


def test_lights_are_shown_in_their_colour():
    made, found = CASES["signals"], set()
    lanes = [lane for lane in made.road.lanes if any(link.signal for link in made.road.exits[lane.id])]
    for lane in lanes[::4]:
        pose = (*lane.centre[-1], 0.3)
        seen = Eye(made, lane.centre[-1]).sees(0, *pose)
        assert (seen == slow_raster(made, 0, *pose)).all(axis=-1).mean() > 0.99
        found |= {tuple(colour) for colour in seen.reshape(-1, 3).tolist()}
    assert {tuple(COLOURS[RED].tolist()), tuple(COLOURS[GREEN].tolist())} <= found


def test_up_is_ahead_and_left_is_left():
    made = scene((0, 0, 0.0), (10, 3.2, 0.0))
    eye = Eye(made)
    body = (eye.sees(0, 0.0, 0.0, 0.0) == COLOURS[OTHER]).all(axis=-1)
    rows, columns = np.nonzero(body)
    assert rows.mean() == pytest.approx(95.5 - 10.0 / PAPERS.pixel_m, abs=6), "without its heading mark"
    assert columns.mean() == pytest.approx(95.5 - 3.2 / PAPERS.pixel_m, abs=1.0)
    turned = (eye.sees(0, 0.0, 0.0, np.pi / 2) == COLOURS[OTHER]).all(axis=-1)
    assert np.nonzero(turned)[1].mean() > 95.5 + 40, "what was ahead is right of an ego that turned left"


def test_the_ego_is_not_drawn_and_absent_agents_are_not():
    made = scene((0, 0, 5.0), (8, 0, 5.0))
    eye = Eye(made)
    assert (eye.sees(0, 0.0, 0.0, 0.0)[96, 96] == COLOURS[SURFACE]).all()
    hidden = Surroundings(eye.view(0).boxes, eye.view(0).speed, jnp.zeros(1, bool), eye.view(0).lights)
    pose = Motion(*map(jnp.float32, (-eye.origin[0], -eye.origin[1], 0.0, 0.0)))
    assert not (np.asarray(RENDER(eye.ground, eye.bars, hidden, pose)) == COLOURS[OTHER]).all(axis=-1).any()


def test_of_a_crowd_the_nearest_are_drawn():
    crowd = [(3.0 * (i % 7) - 9.0, 2.2 * (i // 7) - 9.0, 0.0) for i in range(MOST + 20)]
    made = scene((0, 0, 0.0), *crowd)
    seen = Eye(made).sees(0, 0.0, 0.0, 0.0)
    near = np.argsort([np.hypot(x, y) for x, y, _ in crowd])[: MOST // 2]
    for x, y, _ in (crowd[i] for i in near):
        row, column = round(95.5 - (x - 1.0) / PAPERS.pixel_m), round(95.5 - y / PAPERS.pixel_m)
        assert seen[row, column, 2] == 252, "the rear of a near one, or a mark on it"


def test_no_vehicle_and_no_light_is_left_out_for_those_that_are_not_there():
    """Arrays are filled up with absent boxes at the origin, which may lie under the ego."""
    one, absent = scene((0, 0, 0.0), (12.0, 3.2, 0.0)), MOST + 8
    eye = Eye(one)
    alone = eye.sees(0, 0.0, 0.0, 0.0)
    view = eye.view(0)
    boxes = jax.tree.map(lambda v: jnp.concatenate([jnp.zeros(absent), v]), view.boxes)
    lights = jnp.concatenate([jnp.zeros(absent, jnp.uint8), jnp.array([1], jnp.uint8)])
    bar = Box(*(jnp.array([value], jnp.float32) for value in (8.0 - eye.origin[0], -eye.origin[1], 1.0, 0.0, 1.0, 1.4)))
    bars = jax.tree.map(lambda v: jnp.concatenate([jnp.zeros(absent), v]), bar)
    crowd = Surroundings(
        boxes, jnp.pad(view.speed, (absent, 0)), jnp.pad(view.valid, (absent, 0)), jnp.zeros_like(view.lights)
    )
    ego = Motion(*map(jnp.float32, (-eye.origin[0], -eye.origin[1], 0.0, 0.0)))
    assert (np.asarray(RENDER(eye.ground, eye.bars, crowd, ego)) == alone).all()
    lit = np.asarray(RENDER(eye.ground, bars, eqx.tree_at(lambda v: v.lights, crowd, lights), ego))
    assert (lit == COLOURS[RED]).all(axis=-1).any()


def test_views_in_a_batch_are_the_views_one_by_one():
    made = CASES["merge"]
    eye = Eye(made)
    track = [
        made.tracks.x[0] - eye.origin[0],
        made.tracks.y[0] - eye.origin[1],
        made.tracks.yaw[0],
        made.tracks.speed[0],
    ]
    egos = Motion(*(jnp.asarray(v[:6], jnp.float32) for v in track))
    together = jax.jit(jax.vmap(observe, (None, None, None, 0)))(eye.ground, eye.bars, eye.view(0), egos)
    for k in range(6):
        alone = RENDER(eye.ground, eye.bars, eye.view(0), jax.tree.map(lambda v, k=k: v[k], egos))
        assert jnp.array_equal(together[k], alone)


@pytest.mark.slow
def test_what_is_in_view_tells_pictures_apart():
    """Moving any agent changes the image only if it changes `in_view`, and that only near the ego."""
    eye, rng, told = Eye(CASES["signals"]), np.random.default_rng(0), 0
    look = jax.jit(lambda view, ego: in_view(view, ego, PAPERS))
    view, ego = eye.view(40), Motion(*(jnp.float32(v) for v in (3.0, -2.0, 0.4, 7.0)))
    before, picture = look(view, ego), RENDER(eye.ground, eye.bars, view, ego)
    for _ in range(200):
        agent, (x, y) = rng.integers(view.boxes.x.shape[0]), rng.uniform(-45, 45, 2) + np.array([ego.x, ego.y])
        put = view.boxes.x.at[agent].set(x), view.boxes.y.at[agent].set(y)
        other = eqx.tree_at(lambda v: (v.boxes.x, v.boxes.y), view, put)
        same = bool((look(other, ego) == before).all())
        assert not same or (RENDER(eye.ground, eye.bars, other, ego) == picture).all()
        told += same
    assert 20 < told < 180
