"""Options that several commands share, with their help texts."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from regents_cosim.attacks.methods.presets import METHODS, AttackConfig, preset, road_users
from regents_cosim.cases.shipped import NETWORKS, located
from regents_cosim.cli.groups import (
    ADVANCED,
    BASELINE,
    OUTPUT,
    PLANNER,
    RUN,
    SEARCH,
    TRAFFIC,
    TRAINING,
    Advanced,
    OfOutput,
    OfRun,
)
from regents_cosim.cli.settings import Asked, asks_for
from regents_cosim.errors import RegentsError
from regents_cosim.planners.names import all_that_may_be_named
from regents_cosim.training.lessons.train_config import FINE_TUNING, TrainConfig

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cyclopts import Token

# The rules of a search that `bench table1` takes.
SEARCH_RULES = (
    "nearest", "adversaries", "patience", "accept", "adversary_may", "starts", "attempts", "sampled",
    "replan_every",
)  # fmt: skip
# A switch that is on by default; only such an option has a `--no-` form.
Switch = Annotated[bool, Parameter(negative_bool="no-")]
Seed = Annotated[int, Parameter(validator=Number(gte=0, lte=2**31 - 1))]
Count = Annotated[int, Parameter(validator=Number(gte=1, lte=1_000_000))]  # at least one
CountOrZero = Annotated[int, Parameter(validator=Number(gte=0, lte=1_000_000))]  # may be zero

Output = Annotated[Path, Parameter(["--output", "-o"], group=OUTPUT)]
OutputIfAny = Annotated[Path | None, Parameter(["--output", "-o"], group=OUTPUT)]
PlannerName = Annotated[str, Parameter(help=f"system under test: {all_that_may_be_named()}", group=PLANNER)]
MethodName = Annotated[
    str,
    Parameter(
        help=f"method of the attack: {'; '.join(f'{name}: {one.in_words}' for name, one in METHODS.items())}; "
        "or your own: an entry point or file.py:CLASS"
    ),
]
PlannerOfCase = Annotated[
    str | None,
    Parameter(
        help="planner that drives the ego, as in `attack --planner`; by default the planner that was attacked, if it "
        "comes with this package: other code that a case names is not run",
        group=PLANNER,
    ),
]
ActTimeout = Annotated[
    float, Parameter(help="longest time for one decision of a planner outside JAX [s]; then it fails", group=ADVANCED)
]
Executor = Annotated[
    str, Parameter(help="where jobs run: local, dask (a worker for each core), or dask:ADDRESS", group=RUN)
]
SettingsFile = Annotated[
    Path | None,
    Parameter(
        "--config",
        help="TOML file of settings; `regents config` writes one with all settings of the command",
        group=RUN,
    ),
]
Networks = Annotated[
    tuple[str, ...],
    Parameter(help=f"shipped networks, or .sumocfg files; default: {', '.join(NETWORKS)}", group=TRAFFIC),
]
Verify = Annotated[Switch, Parameter(help="replay every crash in SUMO", group=ADVANCED)]
Pictures = Annotated[Switch, Parameter(help="save a still picture with every case", group=ADVANCED)]


def _located(type_: object, tokens: "Sequence[Token]") -> Path:
    return located(Path(tokens[0].value))


@Parameter(name="*", group=TRAFFIC)
@dataclass(frozen=True)
class TrafficOptions:
    """Ordinary traffic, with SUMO's own option names, and the windows to cut out of it."""

    config: Annotated[Path | None, Parameter(["--configuration-file", "-c"])] = None
    """SUMO configuration (.sumocfg), or shipped:NETWORK: merge, crossing, signals, roundabout, grid, multilane,
    lane_drop, exit_lane, town or street"""
    source: Annotated[str, Parameter("--from")] = ""
    """where traffic comes from instead of SUMO: highway:ENVIRONMENT, e.g. highway:merge-v1 or highway:my_env.py:NAME"""
    log: Path | None = None
    """logged traffic (a file, or a folder of files) instead of SUMO"""
    count: int = 8
    """number of windows"""
    seed: Seed = 0
    """random seed of SUMO and of the choice of windows"""
    horizon: Annotated[float, Advanced] = 8.0
    """length of a window [s]; a shorter log gives one window of its own length"""
    prefer: Annotated[Literal["conflicts", "pedestrians", "none"], Advanced] = "conflicts"
    """which egos come first: conflicts: those whose path another road user can lawfully cross or join within the
    window, led by those that have to give way to it; pedestrians: those whose path a pedestrian can cross; none: no
    preference"""
    ego: str = "auto"
    """id of a road user of the log; in SUMO: id of a vehicle, a vehicle type or a flow; auto: the log's recording
    vehicle or the ego of its planning problem, else one drawn by --seed"""
    ego_kind: Annotated[Literal["auto", "any", "car", "truck", "bus", "motorcycle"], Advanced] = "auto"
    """kind of the ego; auto: passenger cars first; any: all kinds alike"""
    net: Annotated[Path | None, Parameter(["--net-file", "-n"])] = None
    """SUMO network (.net.xml, .net.xml.gz)"""
    routes: Annotated[str, Parameter(["--route-files", "-r"])] = ""
    """route files, separated by commas"""
    additional: Annotated[str, Parameter(["--additional-files", "-a"], group=ADVANCED)] = ""
    """additional files, separated by commas"""
    begin: Annotated[float | None, Parameter(["--begin", "-b"], group=ADVANCED)] = None
    """start of the simulation [s]"""
    end: Annotated[float | None, Parameter(["--end", "-e"], group=ADVANCED)] = None
    """end of the simulation [s]"""
    fcd: Path | None = None
    """an fcd-output of SUMO (xml, xml.gz, csv) to read instead of running SUMO; needs -n"""
    policy: str = "idm"
    """driver of the ego in highway-env: idm, mdp, random, file.zip, package.module:attribute or file.py:attribute"""
    format: Annotated[str, Advanced] = "auto"
    """format of --log; auto recognises it by the content, a wrong name lists all formats"""
    stride: Annotated[float | None, Advanced] = None
    """time between the starts of two windows of a log [s]; default: the horizon"""
    map: Annotated[Path | None, Advanced] = None
    """lanelet2 map (.osm) of a log, if it is not in the folder of the log"""
    columns: Annotated[Path | None, Advanced] = None
    """TOML file that names the columns of a table (csv, parquet)"""
    radius: Annotated[float, Advanced] = 100.0
    """distance from the ego [m]; road users that never come closer are left out"""
    max_agents: Annotated[int, Advanced] = 64
    """largest number of road users in a window, with the ego; the nearest are kept"""


@Parameter(name="*", group=SEARCH)
@asks_for(AttackConfig)
class SearchOptions:
    """How the attack searches; the preset decides what is not given."""

    may_be_negative: ClassVar[frozenset[str]] = frozenset()  # names of fields
    method: MethodName = "focused"
    adversary_kinds: Annotated[str | None, Advanced] = None
    """kinds of road users that may attack, separated by commas: vehicle, cyclist, pedestrian; default: all (of king and
    regents: vehicle)"""

    def config(self) -> AttackConfig:
        """The preset, with the given options in place of its own."""
        kinds = None if self.adversary_kinds is None else road_users(self.adversary_kinds)
        given: dict[str, Any] = vars(self) | {"adversary_kinds": kinds}
        return preset(**given)


def search_options(method: str) -> type[SearchOptions]:
    """The options of a search, with the fields of the method itself among them. Raises RegentsError."""
    chosen = preset(method)
    fields_of_its_own = frozenset(name for name in chosen.settings if not hasattr(SearchOptions, name))
    values = {"__annotations__": {}, "__doc__": SearchOptions.__doc__, "may_be_negative": fields_of_its_own}
    own = type("SearchOptions", (SearchOptions,), values)
    return Parameter(name="*", group=SEARCH)(asks_for(type(chosen))(own))


@Parameter(name="*", group=ADVANCED)
@asks_for(AttackConfig, only=SEARCH_RULES)
class SearchRules:
    """What a search may try, and what it accepts; the preset decides what is not given."""


@Parameter(name="*", group=SEARCH)
@dataclass(frozen=True)
class CampaignOptions:
    """Options of large runs: the part that is done here, and what is done again."""

    shard: Annotated[str, OfRun] = ""
    """NUMBER/COUNT: do only this share of the windows, e.g. 3/64; default in a SLURM job array: the share of the
    task"""
    retry: Annotated[bool, OfRun] = False
    """also try windows again that failed; by default only missing windows are done"""
    manoeuvres: Annotated[tuple[str, ...], Parameter(["--manoeuvre"])] = ()
    """NAME or NAME=NUMBER: keep only crashes with this manoeuvre of the adversary, e.g. cut_in=10 (an unknown NAME
    lists all), and record more windows until there are NUMBER crashes (default: --count) or the traffic holds no more;
    may be repeated"""
    into: Annotated[Path | None, OfOutput] = None
    """a suite that grows, made if there is none: it gets new crashes that fill an empty cell of the map of behaviours,
    or are better than the best of their cell (`regents suite coverage` shows the map). Windows in the least explored
    surroundings come first; the same command again attacks further windows. With -o the new cases are saved there,
    too"""
    minutes: Annotated[float | None, OfOutput] = None
    """time for --into [min]: rounds of --count windows until then; attacks that have begun are finished. By default
    one round"""

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


@Parameter(name="*", group=BASELINE)
@dataclass(frozen=True)
class BaselineOptions:
    """Comparison with a baseline: whether the planner got worse."""

    baseline: Path | None = None
    """file of accepted outcomes; exit code 1 if the planner newly collides or fails"""
    update: bool = False
    """accept the planner's current outcomes, and list the changes (default file: baseline.json in the suite)"""
    fail_on: str = ""
    """what fails the planner, e.g. "telling min_ttc_s:-5%": events that must not happen, with or without a baseline,
    and how much worse metrics may get; an unknown name lists all"""
    known_as: Annotated[str | None, Parameter("--as")] = None
    """name under which the baseline keeps the planner (default: as typed after --planner); give two versions of a
    planner the same one to compare them"""
    strict: bool = False
    """also fail on improvements that are not accepted yet"""
    markdown: Annotated[Path | None, Parameter(allow_leading_hyphen=True)] = None
    """file for a summary that a pull request can show; - for stdout, in place of the table"""


@Parameter(name="*", group=TRAINING)
@dataclass(frozen=True)
class FineTune:
    """Learning from crashes, and the cases that measure its effect."""

    finetune: Path | None = None
    """a suite of attacked cases: the network learns from the crashes that a careful driver avoids. Training starts
    from the shipped weights (or --resume), keeps as much of the change as ordinary traffic allows, and prints scores
    before and after"""
    held_out: Path | None = None
    """another suite of attacked cases, for the scores; default: every fifth window of the --finetune suite, which is
    then not taught (another fifth of the rest selects the weights)"""
    ordinary: Path | None = None
    """ordinary cases, recorded and not attacked, for the scores; default: every fifth of the training cases, which is
    then not taught"""


@Parameter(name="*", group=TRAINING)
@asks_for(TrainConfig, shown=("epochs", "seed", "teacher", "target", "view"))
class TrainOptions:
    """What the network learns from, how long and how fast."""

    def config(self, from_crashes: bool) -> TrainConfig:
        """The settings for training, or for learning from crashes, with the given options in place of the defaults."""
        known = {name: value for name, value in vars(self).items() if value is not None}
        return replace(FINE_TUNING if from_crashes else TrainConfig(), **known)


@Parameter(name="*", group=OUTPUT)
@dataclass(frozen=True)
class OutputOptions:
    """How results are shown."""

    quiet: bool = False
    """show only the result, no progress"""
    json: bool = False
    """print the result as JSON"""
    wide: bool = False
    """show every column of a table, even if the terminal is too narrow"""
    verbose: Annotated[bool, Parameter(["--verbose", "-v"])] = False
    """report each case and its duration on stderr, instead of a progress bar"""
    log_file: Path | None = None
    """file that the same messages are appended to, with times"""


# Paths that may also be those of a shipped suite, such as `shipped:standard`; each command says what it takes.
CasePath = Annotated[Path, Parameter(converter=_located)]
Cases = Annotated[
    Path,
    Parameter(
        converter=_located,
        help="a case or a folder of cases; shipped:standard, shipped:quickstart and shipped:on_foot come with the "
        "package",
    ),
]
SuiteFolder = Annotated[Path, Parameter(converter=_located, help="a folder of cases")]
# What was asked for as a whole, for the suite that it makes; `run` fills it.
AskedFor = Annotated[Asked, Parameter(parse=False)]
SumoOptions = Annotated[tuple[str, ...], Parameter("--sumo-option", show=False, allow_leading_hyphen=True)]
