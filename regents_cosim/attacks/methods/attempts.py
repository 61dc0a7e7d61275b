"""The search that the methods share: a look at every start, then longer searches from some of the starts.

A look is one roll-out with the planner, without an update. A start that already makes the ego crash as wanted needs no
search; but the looks go on up to a flawless crash that a careful driver avoids with room, by an adversary that drives
as people usually do, and the best is taken. Of the longer searches the first, if the method says so, sample changes of
the drive, the others descend along the gradient. The gradient leads to the nearest crash; where that is not the wanted
one, samples find others, with fewer roll-outs, so they come first.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from regents_cosim.attacks.job import Candidate, Merit, SearchEnd
from regents_cosim.attacks.methods.moves import Descend, Move, Search
from regents_cosim.mirror.bicycle import ControlArrays

USUAL = 0.4  # share of the continuations of its moment that take at least as much effort as a usual adversary
GOOD_ENOUGH = Merit(flawless=True, clear=True, usual=USUAL)  # of a crash with which the looks end
# Makes the longer search of a candidate from a start (None: the log); the last argument says whether it may sample.
LongerSearch = Callable[[Candidate, ControlArrays | None, bool], Search]


class OneDescent(Search):
    """A descent from one start, or a mere look at it."""

    def __init__(self, start: ControlArrays | None, updates: int, every_hit: bool = False) -> None:
        self._move = Descend(start, updates, every_hit)
        self._end: SearchEnd | None = None

    def propose(self) -> Move:
        """Propose the descent."""
        return self._move

    def advance(self, seen: SearchEnd) -> None:
        """Learn how it ended."""
        self._end = seen

    @property
    def finished(self) -> bool:
        """Whether it was made."""
        return self._end is not None

    def result(self) -> SearchEnd | None:
        """How it ended."""
        return self._end


class Attempts(Search):
    """The search for one candidate, up to the first accepted crash or the last attempt.

    Where one adversary is enough, the looks of each candidate come before the longer searches of any.
    """

    def __init__(self, candidate: Candidate, longer: LongerSearch, most_looks: int, samples: Sequence[bool]) -> None:
        """`samples` says of each longer search whether it samples, those that do first."""
        self._candidate, self._longer, self._samples = candidate, longer, samples
        self._most_looks = max(most_looks, candidate.looks)
        self._made = 0  # parts that are over, looks first
        self._planned: list[tuple[bool, ControlArrays | None]] | None = None
        self._near: list[ControlArrays] = []  # starts that crashed the ego, but not as wanted
        self._now: Search | None = None
        self._end: SearchEnd | None = None
        self._best: SearchEnd | None = None  # the best crash of the looks that were accepted

    @property
    def rank(self) -> int:
        """The number of the next part."""
        after = self._made - self._candidate.looks
        return self._made if after < 0 else self._most_looks + after

    def propose(self) -> Move:
        """Propose the next move of the part that is due."""
        if self._now is None:
            self._now = self._next()
        return self._now.propose()

    def advance(self, seen: SearchEnd) -> None:
        """Learn what the move led to; a part that is over gives way to the next."""
        assert self._now is not None
        self._now.advance(seen)
        if not self._now.finished:
            return
        ended = self._now.result()
        assert ended is not None
        self._end, self._now = ended.after(self._end), None
        if self._made < self._candidate.looks and ended.hit:
            self._near.append(self._candidate.starts[self._made])
        self._made += 1
        if self._made > self._candidate.looks or self._end.failed:
            return
        if self._end.accepted and (self._best is None or self._end.merit > self._best.merit):
            self._best = self._end
        if self._best and (self._made == self._candidate.looks or self._best.merit >= GOOD_ENOUGH):
            self._end = self._best_so_far()

    @property
    def finished(self) -> bool:
        """Whether a crash was accepted, or nothing is left to try."""
        if self._end is None or self._now is not None:
            return False
        after = self._made - self._candidate.looks
        if after < 0 and self._end.accepted and self._end.merit < GOOD_ENOUGH:
            return False
        return self._end.is_last or (after >= 0 and after >= len(self._plan()))

    def result(self) -> SearchEnd | None:
        """How the last part ended, with the effort of all; one that was broken off, as far as it came."""
        if self._end is None:
            return self._now and self._now.result()
        return self._best_so_far() if self._made < self._candidate.looks and self._best else self._end

    def _best_so_far(self) -> SearchEnd:
        """The best crash of the looks, with the effort of all."""
        assert self._best is not None
        assert self._end is not None
        return replace(self._best, **{name: getattr(self._end, name) for name in ("seconds", "earlier", "looks")})

    def _next(self) -> Search:
        if self._made < self._candidate.looks:
            return OneDescent(self._candidate.starts[self._made], updates=0, every_hit=True)
        samples, start = self._plan()[self._made - self._candidate.looks]
        return self._longer(self._candidate, start, samples)

    def _plan(self) -> list[tuple[bool, ControlArrays | None]]:
        """The longer searches, each with whether it samples, and what it begins with.

        Starts that crashed the ego come first. The last search that samples, or the last descent if none samples,
        begins with the log; so does the only descent if there are no starts.
        """
        if self._planned is None:
            near, log, samples = self._near, self._candidate.job.start, sum(self._samples)
            starts = [*near, *(one for one in self._candidate.starts if not any(one is other for other in near))]
            descents = len(self._samples) - samples
            if samples:
                changed, descended = (*starts[: samples - 1], log), (starts or [log])[:descents]
                self._planned = [*((True, start) for start in changed), *((False, start) for start in descended)]
            else:
                self._planned = [(False, start) for start in (*starts[: descents - 1], log)]
        return self._planned
