"""The identity of a run: everything that decides its results, settings as well as code.

Other settings make another run, which needs another folder. Other code, of the planner or of this package, is the same
run, all of it to be done again; so a planner that has changed under its name never counts as done.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from regents_cosim.cases.provenance import versions_and_revision
from regents_cosim.errors import CaseError
from regents_cosim.runs.shards import Shard

_SHOWN = 4  # most differing settings in a message


class Identity(msgspec.Struct, frozen=True):
    """Command, settings and code of a run."""

    command: str  # "attack"
    settings: dict[str, Any]  # plain values by option name
    makers: dict[str, str]  # versions of packages, and digests of the planners' files

    def key(self, *of: str) -> str:
        """The key of a unit of work of this run; `of` says what the unit is about."""
        said = json.dumps([self.command, self.settings, self.makers, *of], sort_keys=True)
        return hashlib.sha256(said.encode()).hexdigest()[:20]


def identity(command: str, settings: Mapping[str, Any], planners: Mapping[str, str]) -> Identity:
    """The identity of a command with these settings; `planners` maps names to digests of their files."""
    plain = json.loads(json.dumps(dict(settings), sort_keys=True, default=str))
    code = {f"planner {name}": digest for name, digest in planners.items()}
    return Identity(command, plain, versions_and_revision() | code)


def require_same(folder: Path, before: Identity, now: Identity, shard_before: Shard, shard: Shard) -> None:
    """Raise CaseError where a folder belongs to another run or to another shard of this run."""
    if before.command != now.command:
        raise CaseError(
            f"{folder} was begun with `regents {before.command}`, this is `regents {now.command}`: "
            "choose another folder with -o"
        )
    if differing := _differing(before.settings, now.settings):
        raise CaseError(
            f"{folder} was begun with {_said(differing, before.settings)}, this run has "
            f"{_said(differing, now.settings)}: choose another folder with -o (`regents suite merge` makes one of two)"
        )
    if shard != shard_before:
        raise CaseError(
            f"{folder} was begun as shard {shard_before}, this is shard {shard}: every shard has a folder of its own"
        )


def changed_makers(before: Identity, now: Identity) -> list[str]:
    """Names of packages and planners whose code has changed."""
    return _differing(before.makers, now.makers)


def _differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    return sorted(name for name in {*one, *other} if one.get(name) != other.get(name))


def _said(names: list[str], values: Mapping[str, Any]) -> str:
    said = [f"{name} {json.dumps(values.get(name))}" for name in names[:_SHOWN]]
    return ", ".join(said) + (", ..." if len(names) > _SHOWN else "")
