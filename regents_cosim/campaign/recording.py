"""Record traffic into a folder once."""

from collections.abc import Callable, Sequence
from pathlib import Path

from regents_cosim.campaign.identity import Identity
from regents_cosim.campaign.ledger import DoneUnit, WorkUnit, forget_lost, open_ledger
from regents_cosim.cases.files import load_header
from regents_cosim.cases.manifest import drop_cases
from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario import Scenario


def record_once(
    folder: Path, identity: Identity, traffic: str, seed: int, record: Callable[[], Sequence[Scenario]]
) -> list[str]:
    """Record into a folder unless that is done; return the names of the cases in order.

    `traffic` is a digest of the traffic's files: changed files are recorded again, and outdated cases are removed.
    Raises CaseError where the folder was begun by another run.
    """
    suite = SuiteWriter(folder, seed)
    with open_ledger(folder, identity) as ledger:
        forget_lost(ledger)
        unit = WorkUnit("traffic", identity.key(traffic))
        if not ledger.record.is_done(unit):
            scenarios = record()
            before = {name for one in ledger.record.done.values() for name, _ in one.cases}
            if gone := before.difference(scenario.id for scenario in scenarios):
                drop_cases(gone, folder)
            ledger.plan("", [unit])
            saved = [(scenario.id, load_header(suite.add(scenario)).hash) for scenario in scenarios]
            ledger.note(DoneUnit(unit, tuple(saved)))
        ledger.finish()
        return [name for name, _ in ledger.record.done[unit.name].cases]
