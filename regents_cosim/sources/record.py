"""`record`: traffic of any kind in, Scenarios out."""

import warnings
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path

from regents_cosim.errors import RegentsError
from regents_cosim.scenario import Scenario
from regents_cosim.sources.fcd import record_fcd
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.sumo_config import SumoInput
from regents_cosim.sources.windows import Prefer

_HIGHWAY = "highway:"


def record(
    source: SumoInput | Path | str,
    *,
    fcd: Path | None = None,
    policy: str = "idm",
    count: int = 8,
    seed: int = 0,
    horizon_s: float = 8.0,
    radius_m: float = 100.0,
    prefer: Prefer = "conflicts",
    executor: Executor | None = None,
    tell: Callable[[str], None] = warnings.warn,
) -> list[Scenario]:
    """Up to `count` windows of ordinary traffic; the same seed gives the same.

    `source` is a .sumocfg, a SumoInput, or `highway:` and the id of an environment of highway-env,
    whose ego `policy` drives: idm, mdp, random, `package.module:attribute` or `file.py:attribute`.
    With `fcd`, an fcd-output of SUMO, nothing is run: the network and the vehicle types come from
    `source`. `prefer` says which egos come first, as for `windows.choose_windows`; in highway-env there is one
    alone. `tell` is told what is left out or assumed. Raises RegentsError for bad input, NoWindowError where
    there is no window.
    """
    if isinstance(source, str) and source.startswith(_HIGHWAY):
        from regents_cosim.sources.highway import record_highway  # imports pygame

        return record_highway(
            source.removeprefix(_HIGHWAY),
            policy,
            count=count,
            seed=seed,
            horizon_s=horizon_s,
            radius_m=radius_m,
            executor=executor,
        )
    given = source if isinstance(source, SumoInput) else SumoInput(config=Path(source))
    if fcd is None:
        return record_sumo(
            given,
            count=count,
            seed=seed,
            horizon_s=horizon_s,
            radius_m=radius_m,
            prefer=prefer,
            executor=executor,
            tell=tell,
        )
    if given.net is None:
        raise RegentsError("an fcd-output needs the network it was made on: give it with -n NAME.net.xml")
    types = (*given.routes, *given.additional)
    return record_fcd(
        fcd,
        given.net,
        routes_or_types=types,
        count=count,
        seed=seed,
        horizon_s=horizon_s,
        radius_m=radius_m,
        prefer=prefer,
        tell=tell,
    )
