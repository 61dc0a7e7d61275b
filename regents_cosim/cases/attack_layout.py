"""Attack records of schema 1 and 2, which kept typed fields as words in `settings`.

Such records are read as if written today. Hashes are taken over the former layout, so that a case keeps its hash.
"""

from dataclasses import replace
from typing import Any, get_args

from regents_cosim.attack_record import AttackRecord, Dynamics

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
    """The JSON of a record, with those fields as words in `settings`; unset ones are left out."""
    values = dict(record)
    names = {former: some for former, field in _NAMES.items() if (some := values.pop(field)) is not None}
    if not names["against"]:  # a list is there for every attack, and the word was not
        del names["against"]
    words = {former: " ".join(some) for former, some in names.items()}
    dynamics = values.pop(_DYNAMICS)
    words |= {_DYNAMICS: dynamics} if dynamics else {}
    return values | {"settings": dict(sorted((values["settings"] | words).items()))}
