"""Sessions of an attack into a folder, which may stop between two windows as a kill would stop them."""

from regents_cosim.runs.attack_run import attack_left
from regents_cosim.runs.ledger import open_ledger, redo_lost
from regents_cosim.runs.windows import planned
from regents_cosim.saving import SuiteWriter
from regents_cosim.system.progress import Silent


class StoppedError(Exception):
    """Stands for a kill between two windows."""


class Counted(Silent):
    """Counts what is searched, and stops after some of it."""

    def __init__(self, stop_after=99):
        self.searched, self.stop_after = 0, stop_after

    def each(self, items, what, total, row=None):
        for results in items:
            if self.searched == self.stop_after:
                raise StoppedError
            self.searched += 1
            yield results


def attack_session(folder, windows, run, shard, *, stop_after=99, retry=False):
    """Attack what is left; returns how many windows were searched. Raises StoppedError after `stop_after` of them."""
    progress = Counted(stop_after)
    with open_ledger(folder, run.identity({}, 1), shard) as ledger:
        redo_lost(ledger)
        planned(ledger, windows)
        attack_left(ledger, windows, run, SuiteWriter(folder, 0), retry=retry, progress=progress)
        ledger.finish()
    return progress.searched
