"""Sessions of an attack into a folder, which may stop between two windows as a kill would stop them."""

from regents_cosim.runs.attack_run import attack_left
from regents_cosim.runs.ledger import forget_lost, open_ledger
from regents_cosim.runs.windows import planned
from regents_cosim.saving import SuiteWriter


class StoppedError(Exception):
    """Stands for a kill between two windows."""


def attack_session(folder, windows, run, shard, *, stop_after=99, retry=False):
    """Attack what is left; returns how many windows were searched. Raises StoppedError after `stop_after` of them."""
    searched = 0

    def watch(done, of):
        nonlocal searched
        for results in done:
            if searched == stop_after:
                raise StoppedError
            searched += 1
            yield results

    with open_ledger(folder, run.identity({}, 1), shard) as ledger:
        forget_lost(ledger)
        planned(ledger, windows)
        attack_left(ledger, windows, run, SuiteWriter(folder, 0), still=repr, retry=retry, watch=watch)
        ledger.finish()
    return searched
