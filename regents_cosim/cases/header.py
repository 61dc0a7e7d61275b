"""scenario.json: all of a case except its tracks and its map."""

from dataclasses import dataclass

from regents_cosim.cases.json_files import FLAT_SCHEMA, RAISED_SCHEMA, SCHEMA
from regents_cosim.cases.map_files import MapFiles
from regents_cosim.checks.names import require_file_name
from regents_cosim.scenario.attack_record import AttackRecord
from regents_cosim.scenario.judgement import Judgement
from regents_cosim.scenario.scenario import Agent, Overlap, Provenance, Scenario, Signal

HEADER = "scenario.json"


@dataclass(frozen=True)
class Behaviour:
    """How the adversary comes to its crash, measured from the tracks."""

    departs_s: float | None  # [s] from when the adversary visibly leaves its log to the contact; None: never visible
    deviation_m: float  # [m] mean distance from its log up to the contact


@dataclass(frozen=True)
class Header:
    """The content of scenario.json, without `schema`: all of a case except its tracks and its map."""

    id: str
    hash: str
    dt: float
    ego: str
    target: tuple[float, float]
    agents: tuple[Agent, ...]
    map: MapFiles
    signals: tuple[Signal, ...]
    overlaps: tuple[Overlap, ...]
    provenance: Provenance
    attack: AttackRecord | None
    judgement: Judgement | None = None
    tags: tuple[str, ...] | None = None  # None: saved by a version without tags
    behaviour: Behaviour | None = None  # None: no crash, or saved by a version without this field

    def __post_init__(self) -> None:
        require_file_name(self.id, "case id")


def schema_of(scenario: Scenario) -> int:
    """The oldest schema that can hold a scenario."""
    if scenario.attack is not None:
        return SCHEMA
    tracks = filter(None, (scenario.tracks, scenario.log, scenario.evasion))
    return RAISED_SCHEMA if scenario.road.raised or not all(track.flat for track in tracks) else FLAT_SCHEMA


def header_of(scenario: Scenario, files: MapFiles, digest: str) -> Header:
    """The header of a case whose map is in `files` and whose hash is `digest`."""
    return Header(
        id=scenario.id,
        hash=digest,
        dt=scenario.dt,
        ego=scenario.ego.id,
        target=scenario.target,
        agents=scenario.agents,
        map=files,
        signals=scenario.signals,
        overlaps=scenario.overlaps,
        provenance=scenario.provenance,
        attack=scenario.attack,
        judgement=scenario.judgement,
    )
