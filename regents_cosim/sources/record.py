"""Records Scenarios from traffic of any source."""

import warnings
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

from regents_cosim.cases.shipped import located
from regents_cosim.cases.suite import CaseList
from regents_cosim.checks.arguments import as_path
from regents_cosim.errors import RegentsError
from regents_cosim.simulators import ANY_EGO
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.sources.fcd import record_fcd
from regents_cosim.sources.left_out import told_left_out
from regents_cosim.sources.logs.formats import CompanionFiles
from regents_cosim.sources.logs.record import record_log
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import EgoKind, Prefer, Windows, no_cars
from regents_cosim.system.progress import ShowProgress, progress_for

_HIGHWAY = "highway:"
_SUMO = ".sumocfg"


@dataclass(frozen=True)
class LogInput:
    """Logged traffic with details that its path alone does not give."""

    path: Path  # a file, or a folder of files
    format: str = "auto"  # auto recognises it by the content
    ego: str = "auto"  # id of a road user; auto: the ego of the log, else one by seed
    stride_s: float | None = None  # [s] between the starts of two windows; None: the horizon
    map: Path | None = None  # lanelet2 map (.osm), if it is not in the folder of the log
    columns: Path | None = None  # TOML file that names the columns of a table (csv, parquet)

    def __post_init__(self) -> None:
        """Texts become paths. Raises RegentsError."""
        for name in ("path", "map", "columns"):
            if name == "path" or getattr(self, name) is not None:
                object.__setattr__(self, name, as_path(getattr(self, name), name))
        if not isinstance(self.ego, str):
            raise RegentsError(f"`ego` is {self.ego!r}, expected a text: ids of road users are texts")


def record(
    source: SumoInput | LogInput | Path | str,
    *,
    fcd: Path | str | None = None,
    policy: str = "idm",
    count: int = 8,
    seed: int = 0,
    horizon_s: float = 8.0,
    radius_m: float = 100.0,
    prefer: Prefer = "conflicts",
    max_agents: int = 64,
    ego_kind: EgoKind = "auto",
    executor: Executor | None = None,
    tell: Callable[[str], None] = warnings.warn,
    progress: ShowProgress = True,
) -> CaseList:
    """Record up to `count` windows of ordinary traffic; the same seed gives the same windows.

    `source` is one of

    - a .sumocfg, `shipped:merge` or another shipped one, or a SumoInput. With `fcd`, an fcd-output of SUMO, nothing is
      run: the network and the vehicle types come from the SumoInput;
    - `highway:` and the id of an environment of highway-env, or `package.module:NAME` or `file.py:NAME` of your own.
      `policy` drives its ego: idm, mdp, random, `package.module:attribute` or `file.py:attribute`;
    - any other file or folder: logged traffic of any known format, or a LogInput.

    A window lasts `horizon_s` [s]. `prefer` says which egos come first: those in a possible conflict, those whose path
    a pedestrian can cross, or none; highway-env has only one ego. `ego_kind` "auto" prefers passenger cars, "any" does
    not, and the name of a kind allows no other. If more than `max_agents` road users are within `radius_m` [m] of the
    ego, the nearest are kept. `provenance.left_out` of a window lists what it leaves out, and `tell` is called with a
    message for each thing that is left out or assumed. SUMO runs in its own process, or in those of `executor`. A
    progress bar is shown on terminals and in notebooks unless `progress` is False.

    Raises RegentsError for bad input, NoWindowError if there is no window.
    """
    windows = Windows(count, seed, horizon_s, radius_m, prefer=prefer, max_agents=max_agents, ego_kind=ego_kind)
    given = traffic_input(source)
    if fcd is not None and not isinstance(given, SumoInput):
        raise RegentsError(f"{fcd}: expected the network of this fcd-output, a SumoInput, in place of {source}")
    with progress_for(progress).waiting("reading the log" if isinstance(given, LogInput) else "recording traffic"):
        if isinstance(given, str):
            from regents_cosim.sources.highway import record_highway  # imports pygame

            found = record_highway(given.removeprefix(_HIGHWAY), policy, windows, executor)
        elif isinstance(given, LogInput):
            found = record_log(
                given.path,
                windows,
                format=given.format,
                ego=given.ego,
                stride_s=given.stride_s,
                beside=CompanionFiles(given.map, given.columns),
                tell=tell,
            )
        elif fcd is None:
            found = record_sumo(given, windows, executor=executor, tell=tell)
        elif given.net is None:
            raise RegentsError("an fcd-output needs the network it was made on: give it with -n NAME.net.xml")
        else:
            types = (*given.routes, *given.additional)
            found = record_fcd(
                as_path(fcd, "fcd"), given.net, replace(windows, ego=given.ego), routes_or_types=types, tell=tell
            )
    drawn = isinstance(given, str) or given.ego == ANY_EGO
    if drawn and ego_kind == "auto" and (said := no_cars(found)):
        tell(said)
    for said in told_left_out(found):
        tell(said)
    return CaseList(found)


def traffic_input(source: SumoInput | LogInput | Path | str) -> SumoInput | LogInput | str:
    """The input that a path refers to: a SumoInput for a configuration of SUMO, else a LogInput.

    An input, and the name of an environment of highway-env, are returned unchanged.
    """
    if isinstance(source, SumoInput | LogInput) or (isinstance(source, str) and source.startswith(_HIGHWAY)):
        return source
    path = located(as_path(source, "source"))
    return SumoInput(config=path) if path.suffix == _SUMO else LogInput(path)
