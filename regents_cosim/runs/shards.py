"""Shards: the share of a run's units that one folder, on one machine, works on."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from regents_cosim.errors import RegentsError

_Unit = TypeVar("_Unit")
_MOST = 1_000_000


@dataclass(frozen=True)
class Shard:
    """Share `number` of `count`, counted from 1."""

    number: int = 1
    count: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count <= _MOST:
            raise RegentsError(
                f"shard {self.number}/{self.count}, expected NUMBER/COUNT with a number from 1 to the count, as in 3/64"
            )

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @property
    def every(self) -> slice:
        """The slice of a sequence for this shard, where items are worked on one by one."""
        return slice(self.number - 1, None, self.count)

    def of(self, units: Sequence[_Unit], together: int = 1) -> list[_Unit]:
        """The units of this shard: every `count`-th one, or every `count`-th group of `together` neighbours.

        All shards see the whole of a long recording, so that none gets the whole rush hour.
        """
        return [unit for at, unit in enumerate(units) if at // together % self.count == self.number - 1]


WHOLE = Shard()


def parse_shard(text: str) -> Shard:
    """Parse text such as `3/64`. Raises RegentsError."""
    found = re.fullmatch(r"(\d{1,7})/(\d{1,7})", text.strip())
    if found is None:
        raise RegentsError(f"shard {text!r}, expected NUMBER/COUNT, as in 3/64")
    return Shard(int(found[1]), int(found[2]))


def slurm_shard(environment: Mapping[str, str]) -> Shard | None:
    """The shard of a task of a SLURM job array; None outside of one.

    Source: SLURM's job array support, https://slurm.schedmd.com/job_array.html: SLURM_ARRAY_TASK_ID, _COUNT, _MIN and
    _STEP. Arrays may begin with any number, and have steps.
    """
    names = ("ID", "COUNT", "MIN", "STEP")
    found = {name: environment.get(f"SLURM_ARRAY_TASK_{name}", "") for name in names}
    if not (found["ID"].isdigit() and found["COUNT"].isdigit()):
        return None
    first = int(found["MIN"]) if found["MIN"].isdigit() else 0
    step = int(found["STEP"]) if found["STEP"].isdigit() and int(found["STEP"]) > 0 else 1
    return Shard((int(found["ID"]) - first) // step + 1, int(found["COUNT"]))
