"""Small scenes made by hand, for tests that need no simulator."""

from dataclasses import replace

import numpy as np
import shapely

from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.scenario.attack_record import AttackRecord, Collision
from regents_cosim.scenario.collisions import collision_type_of, first_contact
from regents_cosim.scenario.scenario import Agent, Provenance, Scenario, Tracks

DT = 0.1
TIME = DT * np.arange(81)  # [s] of a scene of the usual length
PROVENANCE = Provenance("test", "made by hand", "0" * 64, 0.0)


def straight_road(lanes: int = 3, width: float = 3.2) -> RoadMap:
    """Lanes along +x from -200 to 600 m, the rightmost at y = 0."""
    names = [f"lane{i}" for i in range(lanes)]
    return RoadMap(
        lanes=tuple(
            Lane(
                name,
                np.array([[-200.0, i * width], [600.0, i * width]]),
                width,
                15.0,
                left=names[i + 1] if i + 1 < lanes else None,
                right=names[i - 1] if i else None,
            )
            for i, name in enumerate(names)
        ),
        connections=(),
        drivable=shapely.box(-200.0, -width / 2, 600.0, (lanes - 0.5) * width),
    )


def scene(*cars: tuple[float, float, float], steps: int = 81, name: str = "scene", **changes) -> Scenario:
    """Cars (x, y, speed) that go straight on along +x; the first is the ego."""
    x0, y0, speed = (np.array(values, float)[:, None] for values in zip(*cars, strict=True))
    time = DT * np.arange(steps)
    x = x0 + speed * time
    tracks = Tracks(x, y0 + 0 * x, 0 * x, speed + 0 * x, np.ones(x.shape, bool))
    agents = tuple(Agent(f"car{i:02d}", "car", 4.6, 1.8, "background" if i else "ego") for i in range(len(cars)))
    values = {
        "id": name,
        "dt": DT,
        "agents": agents,
        "tracks": tracks,
        "target": (float(x[0, -1]), float(y0[0, 0])),
        "road": straight_road(),
        "provenance": PROVENANCE,
    }
    return Scenario(**(values | changes))


def platoon(cars: int = 9, seed: int = 0) -> Scenario:
    """Three lanes of cars at about 10 m/s, the ego in the back row."""
    rng = np.random.default_rng(seed)
    rows = ((18.0 * (i // 3) + rng.uniform(0, 3), 3.2 * (i % 3), rng.uniform(9.5, 10.5)) for i in range(cars))
    return scene(*rows, name=f"platoon{seed}")


def moved(made: Scenario, agent: int, **rows: object) -> Tracks:
    """The tracks of `made` with other rows of one agent."""
    changed = {name: np.array(getattr(made.tracks, name)) for name in rows}
    for name, values in rows.items():
        changed[name][agent] = values
    return replace(made.tracks, **changed)


def moving(made: Scenario, agent: int, **rows: object) -> Scenario:
    """The scenario with other rows of one agent's track."""
    return replace(made, tracks=moved(made, agent, **rows))


def absent(made: Scenario, *gone: tuple[int, object]) -> Scenario:
    """The scenario without some agents at some steps, each pair an agent and its steps, where all values are 0."""
    valid = np.array(made.tracks.valid)
    for agent, steps in gone:
        valid[agent, steps] = False
    rows = {name: np.where(valid, getattr(made.tracks, name), 0.0) for name in ("x", "y", "yaw", "speed")}
    return replace(made, tracks=Tracks(**rows, valid=valid))


def crash(made: Scenario, tracks: Tracks | None = None, attributed: bool = True) -> Scenario:
    """`made` as if an attack had changed its tracks to `tracks`, which hold a collision of the ego."""
    tracks = made.tracks if tracks is None else tracks
    agent, step = first_contact(made.agents, tracks)
    kind = collision_type_of(made.agents, tracks, agent, step)
    hit = Collision(made.agents[agent].id, step, DT * step, kind, 5.0, attributed)
    agents = tuple(replace(a, role="adversary") if i == agent else a for i, a in enumerate(made.agents))
    record = AttackRecord(made.id, "king", "idm", "collision", 3, hit)
    return replace(made, agents=agents, tracks=tracks, attack=record, log=made.tracks)
