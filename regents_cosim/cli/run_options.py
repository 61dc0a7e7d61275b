"""Shared parts of commands that can resume: the run, its shards, and its choice of cases."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from regents_cosim.cli.groups import ADVANCED, SEARCH, Advanced, OfOutput, OfRun
from regents_cosim.cli.options import MapAxes
from regents_cosim.errors import RegentsError

if TYPE_CHECKING:
    from regents_cosim.cli.terminal import Terminal
    from regents_cosim.runs.archive.axes import Axes
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
    archive: bool = False
    """keep only the best crash of each cell of the map of behaviours: telling before preventable before clean, then by
    the most usual adversary, then by the least deviation (`regents suite coverage` shows the map)"""
    axes: Annotated[MapAxes, Advanced] = ""
    rollouts: Annotated[int | None, Parameter(validator=Number(gte=0, lte=1_000_000), group=ADVANCED)] = None
    """roll-outs per window with --archive; the search goes on after its first crash and looks for different ones
    (CMA-ME, by the rules of focused); default 2000. 0: the search of --method, which ends at its first crash"""
    into: Annotated[Path | None, OfOutput] = None
    """an existing suite that new crashes are added to: those in an empty cell of the map of behaviours, or better than
    the best in theirs; windows in the least explored surroundings are attacked first. With -o the new cases are saved
    there too"""
    minutes: Annotated[float | None, OfOutput] = None
    """time for --into [min]; attacks that have begun by then are finished. Default 10"""

    def map_axes(self) -> "Axes | None":
        """The axes of the map of behaviours for --archive or --into; None without. Raises RegentsError."""
        from regents_cosim.runs.archive.axes import parse_axes

        if self.rollouts is not None and not self.archive:
            raise RegentsError("`rollouts` belongs to a search for an archive: expected --archive as well")
        if self.axes and not self.archive and self.into is None:
            raise RegentsError("`axes` belongs to a map of behaviours: expected --archive or --into as well")
        if self.archive and self.manoeuvres:
            raise RegentsError("--archive and --manoeuvre choose crashes differently: expected one of them")
        return parse_axes(self.axes) if self.archive or self.into is not None else None

    def time(self, executor: str) -> float:
        """The time for a suite that grows [min]. Raises RegentsError for options that do not go together."""
        from regents_cosim.runs.growing import MINUTES

        if self.into is None:
            if self.minutes is not None:
                raise RegentsError("--minutes is the time for a suite that grows: expected --into SUITE as well")
            return MINUTES
        also = {"--archive": self.archive, "--manoeuvre": self.manoeuvres, "--shard": self.shard, "--retry": self.retry}
        also["--executor"] = executor != "local"
        if named := [name for name, given in also.items() if given]:
            raise RegentsError(f"--into chooses and continues by rules of its own: leave out {', '.join(named)}")
        return MINUTES if self.minutes is None else self.minutes


def share(asked: str, terminal: "Terminal") -> "Shard":
    """The share asked for, or that of this task of a SLURM array, with a message. Raises RegentsError."""
    from regents_cosim.runs.shards import WHOLE, parse_shard, slurm_shard

    if asked:
        return parse_shard(asked)
    found = slurm_shard(os.environ)
    if found is not None:
        terminal.say(f"shard {found}, by SLURM's job array (--shard 1/1 does all of it)")
    return found or WHOLE
