"""Could the ego have avoided the crash? A bank of manoeuvres, tried against everybody else's fixed tracks.

Sound: a collision counts as avoidable only with a track of the ego that comes nobody nearer than
0.1 m up to the end of the horizon, by the exact boxes, and keeps to the road. To be late is not
to evade: for 2 s beyond the horizon the one that was hit goes straight on, and the manoeuvre must
clear it there too. Not complete: where the whole bank fails, another manoeuvre might have worked.

Fixed means that nobody makes way: the adversary and everybody else drive as in the attacked
case. A follower who does not brake for a braking ego spoils that manoeuvre, though a real one
would have braked; that makes the verdict strict. And an adversary that was sent to where the ego
would be is not sent anew; that makes it lenient towards egos that do anything else early.
`last_onset_step` tells the early escapes from the late ones.
"""

from dataclasses import replace

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.boxes import Boxes, corners, overlap
from regents_cosim.collisions import apart_at_entry
from regents_cosim.errors import ScenarioError
from regents_cosim.levels import BAND_M, band, drivable_at, has_levels
from regents_cosim.limits import OFF_ROAD_M
from regents_cosim.scenario import Avoidability, Collision, Scenario, Tracks
from regents_cosim.verdicts.manoeuvres import BANK, Bank, Fan, fans
from regents_cosim.verdicts.perception import perceived_step, reacts_step
from regents_cosim.verdicts.preference import Preference

_MARGIN_M = 0.1  # on every side of the ego: simulators that place it elsewhere by millimetres agree
_ROOM_M = 0.5  # what a careful driver leaves, where there is so much
_BEYOND_S = 2.0
_BEYOND_M = 100.0  # around the ego's track: the road that manoeuvres are held against


def avoidability(attacked: Scenario, bank: Bank = BANK) -> tuple[Avoidability, Tracks | None]:
    """Whether a manoeuvre that begins before the collision avoids it, and the one that a careful driver would do.

    That one is the first by `preference`, and comes with its track [1, time]. Raises ScenarioError where there is no
    collision.
    """
    hit = attacked.attack.collision if attacked.attack else None
    if hit is None:
        raise ScenarioError(f"case {attacked.id} holds no collision, expected one that the ego may avoid")
    perceived = perceived_step(attacked, [agent.id for agent in attacked.agents].index(hit.agent))
    reacts = reacts_step(perceived, attacked.dt)
    others, road = _Others(attacked, hit, _MARGIN_M), _Road(attacked)
    tried, evading = 0, list[Fan]()
    for fan in fans(bank, attacked, hit.step, others.steps, also=(perceived, reacts)):
        tried += len(fan)
        left = road.keeping_to_it(others.untouched_by(fan))
        evading += [left] if len(left) else []
    if not evading:
        return Avoidability(False, tried, 0, None, None, False, perceived), None
    preference = Preference(attacked, hit, bank, perceived, reacts)
    tier = next(kept for tier in preference.tiers(evading) if (kept := [fan for fan in tier if len(fan)]))
    fan, index = _gentlest(_roomy(tier, _Others(attacked, hit, _ROOM_M)), bank)
    one = fan.take(np.array([index]))
    verdict = Avoidability(
        avoidable=True,
        tried=tried,
        evading=sum(map(len, evading)),
        last_onset_step=evading[0].onset,
        gentlest=replace(
            one.manoeuvre(0, bank), side=preference.side(one)[0], runs_red=bool(preference.runs_red(one)[0])
        ),
        in_time=bool(fan.onset >= reacts and preference.answers(one)[0]),
        perceived_step=perceived,
    )
    return verdict, one.tracks(0, attacked)


def _roomy(tier: list[Fan], others: "_Others") -> list[Fan]:
    """Those that keep more room; all of them where none does."""
    roomy = [kept for fan in tier if len(kept := others.untouched_by(fan))]
    return roomy or tier


def _gentlest(evading: list[Fan], bank: Bank) -> tuple[Fan, int]:
    accel, lateral_accel = (np.abs([pair[0] for pair in pairs]) for pairs in (bank.along, bank.aside))
    ends = np.array([lasting is not None for _, lasting in bank.along])
    found = []
    for fan in evading:
        keys = (ends[fan.along], np.round(fan.friction_share, 6), lateral_accel[fan.aside], accel[fan.along])
        index = int(np.lexsort(keys[::-1])[0])
        found.append((*(float(key[index]) for key in keys), -fan.onset, fan, index))
    *_, fan, index = min(found, key=lambda entry: entry[:5])
    return fan, index


class _Others:
    """Whom a manoeuvre may not touch, and where they are up to a little beyond the horizon.

    Left out are only those who overlap the ego already when they first appear (`collisions`).
    """

    def __init__(self, attacked: Scenario, hit: Collision, margin_m: float) -> None:
        tracks = attacked.tracks
        ahead = attacked.dt * np.arange(1, round(_BEYOND_S / attacked.dt) + 1)
        speed, yaw = tracks.speed[:, -1:], tracks.yaw[:, -1:]
        self._x = np.hstack([tracks.x, tracks.x[:, -1:] + speed * np.cos(yaw) * ahead])
        self._y = np.hstack([tracks.y, tracks.y[:, -1:] + speed * np.sin(yaw) * ahead])
        self._yaw = np.hstack([tracks.yaw, yaw + 0.0 * ahead])
        self._z = np.hstack([tracks.z, tracks.z[:, -1:] + 0.0 * ahead])
        self._heights = attacked.heights
        was_hit = np.array([agent.id == hit.agent for agent in attacked.agents])
        self._valid = np.hstack([tracks.valid, np.outer(was_hit & tracks.valid[:, -1], np.ones_like(ahead, bool))])
        self._length, self._width = np.array([(agent.length, agent.width) for agent in attacked.agents]).T
        self._length[0] += 2.0 * margin_m
        self._width[0] += 2.0 * margin_m
        may_be_hit = np.flatnonzero(apart_at_entry(attacked.agents, tracks))
        self._agents = sorted(may_be_hit.tolist(), key=lambda agent: not was_hit[agent])  # the hit one spoils most

    @property
    def steps(self) -> int:
        """Instants, those beyond the horizon included."""
        return self._x.shape[1]

    def untouched_by(self, fan: Fan) -> Fan:
        """Manoeuvres that overlap none of them at any step."""
        if not len(fan):
            return fan
        size = np.hypot(self._length, self._width)
        reach = 0.5 * (size[:1] + size)[:, None]
        near = self._valid[:, fan.onset :].copy()
        for mine, all_ in ((fan.x, self._x), (fan.y, self._y)):
            theirs = all_[:, fan.onset :]
            near &= (mine.min(axis=0) - reach <= theirs) & (theirs <= mine.max(axis=0) + reach)
        for agent in self._agents:
            steps = np.flatnonzero(near[agent])
            if len(steps):
                fan = fan.take(~self._touched(fan, agent, steps, float(reach[agent, 0])))
        return fan

    def _touched(self, fan: Fan, agent: int, steps: np.ndarray, reach: float) -> Bool[np.ndarray, " manoeuvre"]:
        """Which manoeuvres overlap `agent` at one of `steps` after the onset; nobody overlaps beyond `reach` [m]."""
        x, y, yaw, z = (values[agent, fan.onset + steps] for values in (self._x, self._y, self._yaw, self._z))
        row, step = np.nonzero((fan.x[:, steps] - x) ** 2 + (fan.y[:, steps] - y) ** 2 <= reach**2)
        at = row, steps[step]
        own_z = self._heights.of(0, fan.x[at], fan.y[at])
        mine = Boxes(fan.x[at], fan.y[at], fan.yaw[at], self._length[0], self._width[0], own_z)
        theirs = Boxes(x[step], y[step], yaw[step], self._length[agent], self._width[agent], z[step])
        touched = np.zeros(len(fan), bool)
        touched[row[overlap(mine, theirs)]] = True
        return touched


class _Road:
    """Where the ego may drive, with the tolerance of `clean`."""

    def __init__(self, attacked: Scenario) -> None:
        own = attacked.tracks
        bounds = [edge(values[0]) for edge in (np.min, np.max) for values in (own.x, own.y)]
        around = np.add(bounds, [-_BEYOND_M, -_BEYOND_M, _BEYOND_M, _BEYOND_M])
        self._steps = own.steps
        self._near = around.tolist()
        self._road, self._heights, self._ego = attacked.road, attacked.heights, attacked.ego
        self._allowed: dict[int, BaseGeometry] = {}  # by level

    def keeping_to_it(self, fan: Fan) -> Fan:
        """Manoeuvres that take no corner off the road, up to the horizon, which was on it at the onset."""
        for stride in (5, 1):  # few steps tell most of those that leave it
            steps = np.s_[:, : self._steps - fan.onset : stride]
            places = corners(Boxes(fan.x[steps], fan.y[steps], fan.yaw[steps], self._ego.length, self._ego.width))
            on = self._contains(places, self._heights.of(0, fan.x[steps], fan.y[steps]))
            fan = fan.take(np.all(on | ~on[:, :1], axis=(1, 2)))
        return fan

    def _contains(
        self, places: Float[np.ndarray, "*axes corner 2"], z: Float[np.ndarray, "*axes"]
    ) -> Bool[np.ndarray, "*axes corner"]:
        """Whether places are on the road of their level, at heights `z` [m]."""
        if not has_levels(self._road):
            return shapely.contains_xy(self._area(0), places[..., 0], places[..., 1])
        on = np.zeros(places.shape[:-1], bool)
        for level in np.unique(band(z)).tolist():
            here = band(z) == level
            on[here] = shapely.contains_xy(self._area(level), places[here][..., 0], places[here][..., 1])
        return on

    def _area(self, level: int) -> BaseGeometry:
        if level not in self._allowed:
            road = shapely.clip_by_rect(drivable_at(self._road, level * BAND_M), *self._near)
            self._allowed[level] = road.buffer(OFF_ROAD_M)
            shapely.prepare(self._allowed[level])
        return self._allowed[level]
