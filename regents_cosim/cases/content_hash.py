"""The hash of a case, over everything that a replay depends on."""

import hashlib
from dataclasses import dataclass, replace
from typing import Any, get_args

import msgspec

from regents_cosim.cases.header import header_of
from regents_cosim.cases.map_files import map_files
from regents_cosim.cases.track_files import arrays
from regents_cosim.scenario.attack_record import AttackRecord, Dynamics
from regents_cosim.scenario.judgement import Judgement
from regents_cosim.scenario.scenario import Scenario, Tracks


def content_hash(scenario: Scenario) -> str:
    """SHA-256 of everything that a replay depends on: all but the provenance and the effort of the search."""
    return hash_as_stored(scenario, FormerVerdict(), scenario.evasion)


@dataclass(frozen=True)
class FormerVerdict:
    """What older versions stored in a judgement: which of many manoeuvres avoid the crash. Only the hash needs it."""

    avoidability: dict[str, Any] | None = None
    unavoidable: bool | None = None

    @property
    def evades_otherwise(self) -> bool:
        """Whether the stored evasion is another manoeuvre than the careful driver's drive."""
        best = (self.avoidability or {}).get("gentlest")
        return isinstance(best, dict) and best.get("driver") != "careful"


def hash_as_stored(scenario: Scenario, former: FormerVerdict, evasion: Tracks | None) -> str:
    """The hash of a case whose files hold this evasion and, where an older version wrote them, former verdicts."""
    digest = hashlib.sha256()
    content = header_of(scenario, map_files(scenario.road), "")
    for name in ("id", "dt", "target", "agents", "map", "signals", "overlaps"):
        digest.update(msgspec.json.encode(getattr(content, name), order="deterministic"))
    digest.update(_attack_content(scenario.attack))
    if scenario.judgement is not None:
        digest.update(_judgement_content(scenario.judgement, former))
    for tracks in filter(None, (scenario.tracks, scenario.log, evasion)):
        for name, value in arrays(tracks).items():
            digest.update(name.encode() + (b"-" if value is None else value.tobytes()))
    return digest.hexdigest()


def _attack_content(attack: AttackRecord | None) -> bytes:
    """The bytes of an attack that are hashed: without its effort, and without empty fields that older cases lack."""
    values = msgspec.json.decode(msgspec.json.encode(attack, order="deterministic"))
    if values is not None:
        values = in_former_layout(values)
        values.pop("act_time", None)  # absent in records that were read from a file without it
        values.pop("rollouts", None)
        values.pop("drives", None)
        for name in ("planner_error", "spoilt"):
            if not values.get(name):
                values.pop(name, None)
        if hit := values.get("collision"):  # hashed by the former key, so that the hashes of older cases stay
            values["collision"] = {"kind" if name == "collision_type" else name: of for name, of in hit.items()}
    return msgspec.json.encode(values)


def _judgement_content(judgement: Judgement, former: FormerVerdict) -> bytes:
    """The bytes of a judgement that are hashed, without unknown values of fields that older cases lack.

    Whether the crash holds is left out: another version of SUMO may drive the others in another way.
    """
    now = msgspec.json.decode(msgspec.json.encode(judgement, order="deterministic"))
    now |= {"avoidability": former.avoidability, "unavoidable": former.unavoidable}
    values = {name: now[name] for name in (*_FORMER_ORDER, *now) if name in now}
    values.pop("holds", None)  # absent in judgements that were read from a file without it
    _drop_unknown(values, ("law", "drivers", "unavoidable", "usual", "death_risk"))
    if not values.get("edition"):
        values.pop("edition", None)
    for drive in values.get("drivers", ()):
        _drop_unknown(drive, ("rear_ended_by",))
    if (avoidability := values.get("avoidability")) is not None:
        _drop_unknown(avoidability, ("in_time", "perceived_step"))
        if isinstance(gentlest := avoidability.get("gentlest"), dict):
            _drop_unknown(gentlest, ("side", "runs_red", "driver"))
    return msgspec.json.encode(values)


# How judgements began that had former verdicts; hashes are taken over it, so that cases without them keep theirs.
_FORMER_ORDER = ("flaws", "avoidability", "fault", "law", "drivers", "unavoidable")


def _drop_unknown(values: dict[str, Any], names: tuple[str, ...]) -> None:
    """Drop those of `names` that have no value, as older cases lack them."""
    for name in names:
        if values.get(name) is None or values[name] == []:
            values.pop(name, None)


# Attack records of schema 1 and 2 kept typed fields as words in `settings`. They are read as if written today; hashes
# are taken over the former layout, so that a case keeps its hash.
_NAMES = {"against": "against", "crashed": "crashed", "kinds": "promised"}  # former setting, by blanks: field
_DYNAMICS = "dynamics"  # former setting and field


def up_to_date(record: AttackRecord) -> AttackRecord:
    """The record with the fields that `settings` has as words; others stay there."""
    settings, found = dict(record.settings), dict[str, Any]()
    for former, field in _NAMES.items():
        words = settings.get(former)
        if isinstance(words, str) and " ".join(words.split()) == words and (words or former != "against"):
            found[field] = tuple(words.split())
            del settings[former]
    if settings.get(_DYNAMICS) in get_args(Dynamics):
        found[_DYNAMICS] = settings.pop(_DYNAMICS)
    return replace(record, settings=settings, **found) if found else record


def in_former_layout(record: dict[str, Any]) -> dict[str, Any]:
    """The JSON of a record, with those fields as words in `settings`; unset ones are left out.

    A field that the file lacks is absent in the JSON of a record that was read from it.
    """
    values = dict(record)
    names = {former: some for former, field in _NAMES.items() if (some := values.pop(field, None)) is not None}
    if not names.get("against", True):  # a list is there for every attack, and the word was not
        del names["against"]
    words = {former: " ".join(some) for former, some in names.items()}
    dynamics = values.pop(_DYNAMICS, None)
    words |= {_DYNAMICS: dynamics} if dynamics else {}
    return values | {"settings": dict(sorted((values.get("settings", {}) | words).items()))}
