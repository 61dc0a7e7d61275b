"""`record`: traffic of any kind in, Scenarios out."""

from concurrent.futures import Executor
from pathlib import Path

from regents_cosim.errors import RegentsError
from regents_cosim.scenario import Scenario
from regents_cosim.sources.fcd import record_fcd
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.sumo_config import SumoInput


def record(
    source: SumoInput | Path | str,
    *,
    fcd: Path | None = None,
    count: int = 8,
    seed: int = 0,
    horizon_s: float = 8.0,
    radius_m: float = 100.0,
    executor: Executor | None = None,
) -> list[Scenario]:
    """Up to `count` windows of ordinary traffic; the same seed gives the same.

    `source` is a .sumocfg or a SumoInput. With `fcd`, an fcd-output of SUMO, nothing is run: the
    network and the vehicle types come from `source`. Raises RegentsError for bad input,
    NoWindowError where there is no window.
    """
    given = source if isinstance(source, SumoInput) else SumoInput(config=Path(source))
    if fcd is None:
        return record_sumo(given, count=count, seed=seed, horizon_s=horizon_s, radius_m=radius_m, executor=executor)
    if given.net is None:
        raise RegentsError("an fcd-output needs the network it was made on: give it with -n NAME.net.xml")
    types = (*given.routes, *given.additional)
    return record_fcd(
        fcd, given.net, routes_or_types=types, count=count, seed=seed, horizon_s=horizon_s, radius_m=radius_m
    )
