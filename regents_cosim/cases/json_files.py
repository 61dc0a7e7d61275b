"""Read JSON of this package safely: refuse newer schemas, and report any damage in one line."""

import re
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

import msgspec
import shapely

from regents_cosim.checks.bounded import MIB
from regents_cosim.checks.typed_values import from_json
from regents_cosim.errors import CaseError, InputError, ScenarioError
from regents_cosim.scenario.attack_record import CollisionType

SCHEMA = 3  # the newest that is read: attacked cases, whose record has typed fields
RAISED_SCHEMA = 2  # the schema of cases with heights that were never attacked
FLAT_SCHEMA = 1  # the schema of everything else, whose bytes and hashes older versions can read
JSON_BYTES = 64 * MIB  # a case takes 100 KB, with the costs of every iteration; a suite takes 100 bytes a case
_Kind = TypeVar("_Kind")
_FORMER_KEY = re.compile(rb'"kind":(\s*"(?:%s)")' % "|".join(get_args(CollisionType)).encode())
_FORMER_STANDING = b'"standing":"actionable"', b'"standing":"clean"'


def with_new_keys(text: bytes) -> bytes:
    """JSON in which the type of a collision may still have its former key, `kind`, which road users have too.

    A crash in a ledger may have a former standing, which said that it is clean and that some manoeuvre avoids it.
    """
    return _FORMER_KEY.sub(rb'"collision_type":\1', text).replace(*_FORMER_STANDING)


def decode(text: bytes, kind: type[_Kind], path: Path) -> _Kind:
    """Decode JSON of the current schema or an older one into `kind`. Raises CaseError for a newer one."""
    schema = from_json(text, _Schema).schema
    if schema > SCHEMA:
        raise CaseError(
            f"{path}: schema {schema}, this version reads up to {SCHEMA} (upgrade regents_cosim to read it)"
        )
    return from_json(with_new_keys(text), kind)


def in_lines(values: dict[str, Any]) -> bytes:
    """JSON with a line for each value, as all files of a suite are written."""
    return msgspec.json.format(msgspec.json.encode(values), indent=1) + b"\n"


@dataclass(frozen=True)
class _Schema:
    schema: int


@contextmanager
def explain_read(place: Path, what: str = "a file of the case is missing, damaged or truncated") -> Iterator[None]:
    """Turn read errors of the block into a CaseError that names `place`, a file or the folder of a case."""
    try:
        yield
    except CaseError:
        raise
    except (ScenarioError, InputError) as error:
        named = str(place) in str(error)
        raise CaseError(str(error) if named else f"{place}: {error}") from error
    except _UNREADABLE as error:
        said = (str(error).splitlines() or [type(error).__name__])[0]
        raise CaseError(f"{place}: {what} ({said})") from error


_UNREADABLE: tuple[type[Exception], ...] = (
    OSError, EOFError, ValueError, TypeError, KeyError, MemoryError, zipfile.BadZipFile, zlib.error,
    msgspec.MsgspecError, shapely.errors.ShapelyError, RecursionError,
)  # fmt: skip
