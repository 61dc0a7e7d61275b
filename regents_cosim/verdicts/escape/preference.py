"""Order the evading manoeuvres of the bank: late enough to have seen the reason, and as little unusual as possible.

This order is used where the careful driver's own drive (`way_out`) is not shown. From the most preferred on:

1. The manoeuvre is in time and not too early: it begins after the reaction time from when the adversary visibly departs
from its log (`perception`), and within the last 4 s before the collision, as far ahead as a careful driver looks; next
best it begins no earlier than the departure is seen; last at any time, which takes foreknowledge.
2. The ego is out of danger for good: for 3 s beyond the horizon, whichever way within 10 degrees the adversary
continues. Stopping in front of an agent that comes and may pass counts only where there is nothing better.
3. The ego brakes in its lane; next it swerves within the lanes that it may use, then onto the shoulder, then into other
lanes or past a red light.
4. Among those, it begins in the last 2.5 s; takes no more than 4.5 m/s^2; leaves more room than needed; continues until
the danger is over; takes the least share of the tyres' friction, steers less, brakes less, begins later.

Holding the speed, speeding up, braking less than the ego did itself, or braking in the lane so briefly that no more
than 2 m/s are lost is no reaction to anything: it succeeds by the accident of its timing, and counts as foreknowledge.
"""

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.attack_record import Collision
from regents_cosim.geometry.boxes import Boxes, corners
from regents_cosim.judgement import Side
from regents_cosim.routes.ego_route import plan_route
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.escape.manoeuvres import ManoeuvreBank, ManoeuvreSet
from regents_cosim.verdicts.escape.obstacles import Obstacles
from regents_cosim.verdicts.law.lawful_ways import lawful_area

FOR_GOOD_S = 3.0  # beyond the horizon: an ego out of danger for so long needs no luck

_LEFT_M = 0.3  # a corner may be this far outside of an area and still count as inside, as for the road
_FASTER_M_S = 0.1  # faster than the ego itself by more: not a reaction
_DENT_M_S = 2.0  # losing no more speed than this is mere timing
_TO_THE_END_S = 100.0  # longer than any horizon
_BESIDE_M = 0.5  # further from its own way the ego has left its lane
_AHEAD_S = 4.0  # before a collision: the careful driver's foresight
_SOON_S = 2.5  # before a collision: NHTSA's test of collision warnings wants them 2.0 to 2.4 s ahead at the latest
_HARD_M_S2 = 4.5  # harder is an emergency: comfortable systems brake by up to 3.5 to 5 m/s^2 (ISO 15622)
_ROOM_M = 0.5  # distance that a careful driver leaves where it can
_TURNED_RAD = np.deg2rad([0.0, 5.0, -5.0, 10.0, -10.0])  # turns of the adversary beyond the horizon
_LANES_M = 100.0  # around the ego's track

EvadingSets = Sequence[ManoeuvreSet]


class Preference:
    """The choice of a careful driver among manoeuvres, in the place of the ego of one crash."""

    def __init__(self, attacked: Scenario, hit: Collision, bank: ManoeuvreBank, perceived: int, reacts: int) -> None:
        self._attacked, self._bank, self._hit = attacked, bank, hit
        self._until = hit.step
        self.perceived, self.reacts = perceived, reacts

    def first(self, evading: EvadingSets) -> tuple[ManoeuvreSet, int]:
        """The preferred manoeuvre, as its set and its index in that set."""
        tier = next(
            kept for tier in self.tiers(evading) if (kept := [manoeuvres for manoeuvres in tier if len(manoeuvres)])
        )
        others = Obstacles(self._attacked, self._hit, _ROOM_M)
        roomy = [kept for manoeuvres in tier if len(kept := others.untouched_by(manoeuvres))]
        return min((self._gentlest(sets) for sets in (roomy, tier) if sets), key=self._rank)

    def tiers(self, evading: EvadingSets) -> Iterator[EvadingSets]:
        """`evading` in groups, the preferred ones first; the last group holds all of them."""
        answers = [manoeuvres.take(self.answers(manoeuvres)) for manoeuvres in evading]
        soon = self._before_hit(_AHEAD_S)
        for earliest in (max(self.reacts, soon), self.reacts, self.perceived, 0):
            late = [manoeuvres for manoeuvres in answers if manoeuvres.onset >= earliest and len(manoeuvres)]
            yield from self._by_place([self._for_good(manoeuvres) for manoeuvres in late])
            yield from self._by_place(late)
            yield late
        yield evading

    def _by_place(self, sets: EvadingSets) -> Iterator[EvadingSets]:
        """Groups of manoeuvres in the lane, on the own side, on the shoulder."""
        sets = [manoeuvres for manoeuvres in sets if len(manoeuvres)]
        yield [manoeuvres.take(self.in_lane(manoeuvres) & ~self.runs_red(manoeuvres)) for manoeuvres in sets]
        aside = [manoeuvres.take(~self.in_lane(manoeuvres)) for manoeuvres in sets]
        sides = [
            (manoeuvres, np.array(self.side(manoeuvres), dtype=object), self.runs_red(manoeuvres))
            for manoeuvres in aside
        ]
        for wanted in ("own", "shoulder"):
            yield [manoeuvres.take((side == wanted) & ~red) for manoeuvres, side, red in sides]

    def _for_good(self, manoeuvres: ManoeuvreSet) -> ManoeuvreSet:
        """The manoeuvres that the adversary misses whichever way it continues beyond the horizon."""
        for others in self._going_on:
            manoeuvres = others.untouched_by(manoeuvres, since=self._attacked.tracks.steps)
        return manoeuvres

    def _gentlest(self, sets: EvadingSets) -> tuple[ManoeuvreSet, int]:
        accel, lateral_accel = self._accels
        ends = np.array([lasting is not None for _, lasting in self._bank.along])
        found = []
        for manoeuvres in sets:
            share = np.round(manoeuvres.friction_share, 6)
            keys = (
                *self._drastic(manoeuvres),
                ends[manoeuvres.along],
                share,
                lateral_accel[manoeuvres.aside],
                accel[manoeuvres.along],
            )
            index = int(np.lexsort(keys[::-1])[0])
            found.append((*(float(key[index]) for key in keys), -manoeuvres.onset, manoeuvres, index))
        *_, manoeuvres, index = min(found, key=lambda entry: entry[:7])
        return manoeuvres, index

    def _rank(self, found: tuple[ManoeuvreSet, int]) -> list[bool]:
        manoeuvres, index = found
        return [bool(drastic[index]) for drastic in self._drastic(manoeuvres)]

    def _drastic(self, manoeuvres: ManoeuvreSet) -> tuple[np.ndarray, np.ndarray]:
        """Whether manoeuvres begin long before the collision, and whether they are as hard as in an emergency."""
        accel, lateral_accel = self._accels
        hard = np.hypot(accel[manoeuvres.along], lateral_accel[manoeuvres.aside]) > _HARD_M_S2
        return np.full(hard.shape, manoeuvres.onset < self._before_hit(_SOON_S)), hard

    @cached_property
    def _accels(self) -> tuple[np.ndarray, np.ndarray]:
        """Magnitudes [m/s^2] of the longitudinal and the lateral accelerations of the bank."""
        along, aside = (np.abs([pair[0] for pair in pairs]) for pairs in (self._bank.along, self._bank.aside))
        return along, aside

    def _before_hit(self, seconds: float) -> int:
        return self._until - round(seconds / self._attacked.dt)

    def answers(self, manoeuvres: ManoeuvreSet) -> Bool[np.ndarray, " manoeuvre"]:
        """Which manoeuvres are reactions: they brake or steer noticeably, and never exceed the ego's own speed."""
        lost = np.array(
            [-accel * (_TO_THE_END_S if lasting is None else lasting) for accel, lasting in self._bank.along]
        )
        own = self._attacked.tracks.speed[0, manoeuvres.onset : self._until + 1]
        slower = np.all(manoeuvres.speed[:, : len(own)] <= own + _FASTER_M_S, axis=1)
        return slower & ((lost[manoeuvres.along] > _DENT_M_S) | (manoeuvres.aside != 0))

    def in_lane(self, manoeuvres: ManoeuvreSet) -> Bool[np.ndarray, " manoeuvre"]:
        """Which manoeuvres keep to the way that the ego drove; braking may leave a way that exceeded the tyres."""
        kept = manoeuvres.aside == 0
        straight = np.flatnonzero(kept)
        after = np.s_[straight, : self._attacked.tracks.steps - manoeuvres.onset]
        away = shapely.distance(self._own_line, shapely.points(manoeuvres.x[after], manoeuvres.y[after]))
        kept[straight] = np.all(away <= _BESIDE_M, axis=1)
        return kept

    def runs_red(self, manoeuvres: ManoeuvreSet) -> Bool[np.ndarray, " manoeuvre"]:
        """Which manoeuvres pass a light on red that the ego's own drive did not pass on red."""
        runs = np.zeros(len(manoeuvres), bool)
        own = self._attacked.tracks
        for ahead_m, red in self._lights:
            left_m = ahead_m - self._driven[manoeuvres.onset]
            passed = _passes(left_m, _travelled(manoeuvres.speed[:, : own.steps - manoeuvres.onset], self._attacked.dt))
            itself = _passes(left_m, (self._driven - self._driven[manoeuvres.onset])[None, manoeuvres.onset :])
            on_red = np.append(red, False)  # step -1, where a light is never passed
            at = np.where(passed >= 0, passed + manoeuvres.onset, -1)
            runs |= on_red[at] & ~on_red[np.where(itself >= 0, itself + manoeuvres.onset, -1)]
        return runs

    def side(self, manoeuvres: ManoeuvreSet) -> list[Side]:
        """The worst part of the road to which each manoeuvre takes the ego."""
        sides = np.full(len(manoeuvres), "own", dtype=object)
        shifted = np.flatnonzero(~self.in_lane(manoeuvres))
        area = self._own_side
        if area is None or not len(shifted):
            return sides.tolist()
        steps = np.s_[:, : self._attacked.tracks.steps - manoeuvres.onset]
        x, y, yaw = (values[shifted][steps] for values in (manoeuvres.x, manoeuvres.y, manoeuvres.yaw))
        places = corners(Boxes(x, y, yaw, self._attacked.ego.length, self._attacked.ego.width))
        left = ~shapely.contains_xy(area, places[..., 0], places[..., 1])
        left &= ~left[:, :1]
        out = left.any(axis=(1, 2))
        sides[shifted[out]] = "shoulder"
        row = np.broadcast_to(np.arange(len(shifted))[:, None, None], left.shape)[left]
        elsewhere = shapely.contains_xy(self._other_lanes, places[left][:, 0], places[left][:, 1])
        sides[shifted[np.unique(row[elsewhere])]] = "oncoming"
        return sides.tolist()

    @cached_property
    def _going_on(self) -> list[Obstacles]:
        """The others, with the adversary continuing in several directions beyond the horizon."""
        return [Obstacles(self._attacked, self._hit, 0.0, FOR_GOOD_S, turned) for turned in _TURNED_RAD.tolist()]

    @cached_property
    def _own_line(self) -> shapely.LineString:
        """The way that the ego drove, extended straight on."""
        own = self._attacked.tracks
        yaw = own.yaw[0, -1]
        beyond = [own.x[0, -1] + _LANES_M * np.cos(yaw), own.y[0, -1] + _LANES_M * np.sin(yaw)]
        return shapely.LineString(np.vstack([np.stack([own.x[0], own.y[0]], axis=-1), beyond]))

    @cached_property
    def _own_side(self) -> BaseGeometry | None:
        """The area in which the ego may be; None where the map does not tell."""
        area = lawful_area(self._attacked, 0)
        if area is not None:
            area = area.buffer(_LEFT_M)
            shapely.prepare(area)
        return area

    @cached_property
    def _other_lanes(self) -> BaseGeometry:
        """The strips of all lanes around; outside them and the ego's side is shoulder."""
        road, own = self._attacked.road, self._attacked.tracks
        way = shapely.LineString(np.stack([own.x[0], own.y[0]], axis=-1))
        near = road.centre_lines.query(way, predicate="dwithin", distance=_LANES_M)
        strips = [
            shapely.LineString(lane.centre).buffer(0.5 * lane.width, cap_style="flat", quad_segs=2)
            for lane in (road.lanes[index] for index in near.tolist())
        ]
        area = shapely.union_all(strips)
        shapely.prepare(area)
        return area

    @cached_property
    def _driven(self) -> Float[np.ndarray, " time"]:
        """Distance [m] of the ego's own drive by each step."""
        return _travelled(self._attacked.tracks.speed[:1], self._attacked.dt)[0]

    @cached_property
    def _lights(self) -> list[tuple[float, Bool[np.ndarray, " time"]]]:
        """For each light of the ego's route its distance [m] ahead of the ego's front at step 0, and when it is red."""
        if not self._attacked.signals:
            return []
        route, own = plan_route(self._attacked), self._attacked.tracks
        start = shapely.LineString(route.points).project(shapely.Point(own.x[0, 0], own.y[0, 0]))
        front = start + 0.5 * self._attacked.ego.length
        return [(line.distance_m - front, line.red) for line in route.stop_lines]


def _travelled(speed: Float[np.ndarray, "manoeuvre time"], dt: float) -> Float[np.ndarray, "manoeuvre time"]:
    moved = 0.5 * (speed[:, 1:] + speed[:, :-1]) * dt
    return np.concatenate([np.zeros((len(speed), 1)), np.cumsum(moved, axis=1)], axis=1)


def _passes(left_m: float, travelled: Float[np.ndarray, "manoeuvre time"]) -> np.ndarray:
    """The first step at which each has travelled beyond `left_m`; -1 where it never does, or had at the begin."""
    beyond = travelled > left_m
    first = beyond.argmax(axis=1)
    return np.where(beyond.any(axis=1) & (first > 0), first, -1)
