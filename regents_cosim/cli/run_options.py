"""Shared parts of commands that can resume: the run, its shards, and its choice of cases."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from regents_cosim.cli.groups import SEARCH, OfOutput, OfRun
from regents_cosim.errors import RegentsError

if TYPE_CHECKING:
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.runs.shards import Shard


@Parameter(name="*", group=SEARCH)
@dataclass(frozen=True)
class CampaignOptions:
    """Options of large runs: the part that is done here, and what is done again."""

    shard: Annotated[str, OfRun] = ""
    """NUMBER/COUNT: do only this share of the windows, e.g. 3/64; default in a SLURM job array: the share of the
    task"""
    retry: Annotated[bool, OfRun] = False
    """try windows again that failed before; by default only missing ones are done"""
    manoeuvres: Annotated[tuple[str, ...], Parameter(["--manoeuvre"])] = ()
    """NAME or NAME=NUMBER: keep only crashes with this manoeuvre of the adversary (docs/tags.md, e.g. cut_in=10), and
    record more windows until there are NUMBER crashes (default: --count) or the traffic holds no more; may be
    repeated"""
    into: Annotated[Path | None, OfOutput] = None
    """a suite that grows, made if there is none: new crashes are added that are in an empty cell of the map of
    behaviours, or better than the best in theirs (`regents suite coverage` shows the map). Windows in the least
    explored surroundings come first; the same command again attacks further windows. With -o the new cases are saved
    there too"""
    minutes: Annotated[float | None, OfOutput] = None
    """time for --into [min]: rounds of --count windows until then; attacks that have begun are finished. By default one
    round"""

    def check_growth(self, executor: str) -> None:
        """Raise RegentsError for options that a suite that grows lacks, or does not take."""
        if self.into is None:
            if self.minutes is not None:
                raise RegentsError("--minutes is for a suite that grows: expected --into SUITE as well")
            return
        also = {"--manoeuvre": self.manoeuvres, "--shard": self.shard, "--retry": self.retry}
        also["--executor"] = executor != "local"
        if named := [name for name, given in also.items() if given]:
            raise RegentsError(f"--into chooses and continues by rules of its own: leave out {', '.join(named)}")


def share(asked: str, terminal: "Terminal") -> "Shard":
    """The share asked for, or that of this task of a SLURM array, with a message. Raises RegentsError."""
    from regents_cosim.runs.shards import WHOLE, parse_shard, slurm_shard

    if asked:
        return parse_shard(asked)
    found = slurm_shard(os.environ)
    if found is not None:
        terminal.say(f"shard {found}, by SLURM's job array (--shard 1/1 does all of it)")
    return found or WHOLE
