"""Cases that come with the package, for tests: chosen by network, since the suites are rebuilt at times."""

from functools import cache
from pathlib import Path

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import shipped
from regents_cosim.scenario.scenario import Scenario

QUICKSTART = shipped("scenarios") / "quickstart"


def crash_on(network: str) -> Path:
    """The crash of `quickstart` on a network; it has one on each."""
    (folder,) = (case for case in _on(network, QUICKSTART) if not case.name.endswith("-harmless"))
    return folder


def shipped_window(name: str) -> Scenario:
    """A window of `standard` before any attack: `crossing` is the network's first, `crossing-1` its second."""
    network, _, number = name.partition("-")
    return shipped_windows(network)[int(number or 0)]


@cache
def shipped_windows(network: str) -> list[Scenario]:
    """The windows of `standard` of a network, before any attack."""
    cases = _on(network, shipped("scenarios") / "standard")
    each = {case.name.partition("-focused-")[0]: case for case in cases}
    return [load_case(case).before_attack() for case in each.values()]


def _on(network: str, suite: Path) -> list[Path]:
    return [case for case in find_cases(suite) if case.name.startswith(f"{network}-0")]
