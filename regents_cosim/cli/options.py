"""Options that several commands share, each with the words that tell of it."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from regents_cosim.cli.groups import (
    ADVANCED,
    BASELINE,
    OUTPUT,
    PLANNER,
    SEARCH,
    TRAFFIC,
    TRAINING,
    Advanced,
    OfOutput,
    OfSearch,
    OfTraffic,
)
from regents_cosim.planners.names import all_that_may_be_named

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cyclopts import Token

    from regents_cosim.attacks.presets import AttackConfig
    from regents_cosim.evaluation.training.rounds_settings import Rounds
    from regents_cosim.planners.aim_bev.train_config import TrainConfig

# On where it is not turned off: the only kind of option whose negation says something.
Switch = Annotated[bool, Parameter(negative_bool="no-")]
Seed = Annotated[int, Parameter(validator=Number(gte=0, lte=2**31 - 1))]
Count = Annotated[int, Parameter(validator=Number(gte=1, lte=1_000_000))]  # of what there must be one of
CountOrZero = Annotated[int, Parameter(validator=Number(gte=0, lte=1_000_000))]  # of what there may be none of

Output = Annotated[Path, Parameter(["--output", "-o"], group=OUTPUT)]
OutputIfAny = Annotated[Path | None, Parameter(["--output", "-o"], group=OUTPUT)]
PlannerName = Annotated[str, Parameter(help=f"system under test: {all_that_may_be_named()}", group=PLANNER)]
PlannerOfCase = Annotated[
    str | None,
    Parameter(
        help="driver of the ego, any that `attack --planner` takes; by default the planner that was attacked, if it is "
        "one of ours: code that a case names is not run",
        group=PLANNER,
    ),
]
ActTimeout = Annotated[
    float, Parameter(help="a planner outside JAX that takes longer over one decision has failed [s]", group=ADVANCED)
]
Executor = Annotated[
    str, Parameter(help="where the work is done: local, dask (a worker for each core), or dask:ADDRESS", group=ADVANCED)
]
Networks = Annotated[
    tuple[str, ...],
    Parameter(help="shipped networks, or .sumocfg files; by default the six of vehicles alone", group=TRAFFIC),
]
MapAxes = Annotated[
    str,
    Parameter(
        help="axes of the map of behaviours, with commas between them, of manoeuvre, collision_type, closing_speed, "
        "departure, ego, place, lights and density; by default manoeuvre,closing_speed,departure"
    ),
]
Verify = Annotated[Switch, Parameter(help="replay every crash in SUMO", group=OUTPUT)]
Pictures = Annotated[Switch, Parameter(help="draw a still picture into every case", group=OUTPUT)]


def _located(type_: object, tokens: "Sequence[Token]") -> Path:
    from regents_cosim.cases.shipped import located

    return located(Path(tokens[0].value))


@Parameter(name="*", group=TRAFFIC)
@dataclass(frozen=True)
class TrafficOptions:
    """Ordinary traffic, in SUMO's own option names, and the windows to cut out of it."""

    config: Annotated[Path | None, Parameter(["--configuration-file", "-c"])] = None
    """SUMO configuration (.sumocfg), or shipped:NETWORK: merge, crossing, signals, roundabout, grid, multilane,
    lane_drop, exit_lane, town or street"""
    source: Annotated[str, Parameter("--from")] = ""
    """highway:ENVIRONMENT instead of SUMO, e.g. highway:merge-v1"""
    log: Path | None = None
    """logged traffic to read instead: a file, or a folder of files"""
    count: int = 8
    """windows wanted"""
    seed: Seed = 0
    """random seed of SUMO and of the choice of windows"""
    horizon: float = 8.0
    """length of a window [s]; of a log that is shorter, all of it"""
    prefer: Literal["conflicts", "pedestrians", "none"] = "conflicts"
    """egos that come first: conflicts: those whose path another road user can lawfully cross or join within the window;
    pedestrians: those whose path a pedestrian can cross; none: any"""
    ego: str = "auto"
    """id of a logged road user, or in SUMO of a vehicle, a vehicle type or a flow; auto: the recorder's vehicle or the
    planning problem's, else one drawn by seed"""
    ego_kind: Literal["auto", "any", "car", "truck", "bus", "motorcycle"] = "auto"
    """kind of vehicle that the ego may be; auto: passenger cars before the rest; any: whatever is drawn"""
    net: Annotated[Path | None, Parameter(["--net-file", "-n"])] = None
    """SUMO network (.net.xml, .net.xml.gz)"""
    routes: Annotated[str, Parameter(["--route-files", "-r"])] = ""
    """route files, separated by commas"""
    additional: Annotated[str, Parameter(["--additional-files", "-a"])] = ""
    """additional files, separated by commas"""
    begin: Annotated[float | None, Parameter(["--begin", "-b"])] = None
    """begin of the simulation [s]"""
    end: Annotated[float | None, Parameter(["--end", "-e"])] = None
    """end of the simulation [s]"""
    fcd: Path | None = None
    """an fcd-output of SUMO (xml, xml.gz, csv) to read instead of running SUMO; needs -n"""
    policy: Annotated[str, Advanced] = "idm"
    """driver of the ego in highway-env: idm, mdp, random, package.module:attribute or file.py:attribute"""
    format: Annotated[str, Advanced] = "auto"
    """format of --log; auto recognises it by the content, a wrong name lists all formats"""
    stride: Annotated[float | None, Advanced] = None
    """time from one window of a log to the next [s]; the horizon by default"""
    map: Annotated[Path | None, Advanced] = None
    """lanelet2 map (.osm) of a log that does not lie beside it"""
    columns: Annotated[Path | None, Advanced] = None
    """TOML file that names the columns of a table (csv, parquet)"""
    radius: Annotated[float, Advanced] = 100.0
    """agents that never come closer to the ego are left out [m]"""
    max_agents: Annotated[int, Advanced] = 64
    """road users in a window, the ego included; of more, those that come nearest to the ego"""


@Parameter(name="*", group=ADVANCED)
@dataclass(frozen=True)
class SearchRules:
    """What a search may try, and what it accepts; what is not given is the preset's."""

    nearest: int | None = None
    """candidates that get a search of their own"""
    adversaries: Literal["all", "one"] | None = None
    """all: a case for each candidate that succeeds; one: the first success ends the search of a scenario"""
    as_published: bool | None = None
    """follow the public ReGentS code where it departs from its paper (king and regents only)"""
    patience: int | None = None
    """updates without progress after which a search ends; 0: it goes on to the last"""
    accept: Annotated[Literal["any", "clean", "telling"] | None, OfSearch] = None
    """collisions that end a search: any; clean: one that nothing spoils; telling: only one that a careful driver avoids
    as well"""
    law: Annotated[Literal["any", "strict"] | None, OfSearch] = None
    """strict: the adversary keeps to its own lanes and turns, to lights and to the speed limit; on foot to crossings"""
    starts: int | None = None
    """drives on other ways, timed to meet the ego, that are tried for each candidate before it is searched"""
    attempts: int | None = None
    """searches for each candidate, from another start each, until one succeeds"""
    sampled: int | None = None
    """number of these searches, counted from the first, that sample changes (CMA-ES) instead of descending"""
    replan_every: int | None = None
    """iterations between two closed loops of the planner; 1 in the compiled loop, 10 for planners outside it"""


@Parameter(name="*", group=SEARCH)
@dataclass(frozen=True)
class SearchOptions:
    """How the attack searches; what is not given is the preset's."""

    method: Literal["focused", "regents", "king", "random", "cma-es"] = "focused"
    """preset: focused, our own, finds crashes that tell something: a lawful adversary, and a careful driver avoids it;
    regents and king as in the papers; random and cma-es search without gradients, to compare with"""
    search: Literal["joint", "per-candidate"] | None = None
    """one search over all candidates, or one for each of the nearest (every adversary found is a case)"""
    adversary_kinds: str | None = None
    """road users that may attack, with commas between: vehicle, cyclist, pedestrian; by default all (king, regents:
    vehicle)"""
    background: Annotated[Literal["log", "reactive"] | None, Advanced] = None
    """how other agents move: log: as recorded; reactive: they also brake for what stands in their way"""
    dynamics: Annotated[Literal["recorded", "bicycle", "highway"] | None, Advanced] = None
    """model of motion: bicycle: the mirror's; highway: exactly that of highway-env; recorded: that of the
    simulator that the case is from"""
    gradient: Annotated[Literal["adversary", "through-planner"] | None, Advanced] = None
    """adversary: the gradient takes the planner's track as constant; through-planner: it also goes through the planner
    (only in JAX)"""
    iterations: int | None = None
    """updates at most"""
    universal: Annotated[Literal["mean", "worst"] | None, Advanced] = None
    """with --also-crash: lower the mean of the planners' costs, or the cost of the one furthest from a crash"""
    max_deviation: Annotated[float | None, Advanced] = None
    """how far an action may differ from the logged one, as a share of the limit of actions; 0: no bound"""
    driving: Literal["any", "ordinary"] | None = None
    """ordinary: the adversary accelerates, brakes and steers no harder, and with no more jerk, than drivers in the
    traffic of its scene, or than its kind of vehicle is known for; any: as hard as the mirror can"""
    max_accel: Annotated[float | None, Advanced] = None
    """highest acceleration of the adversary, unless its log has more [m/s^2]; 0: as --driving says"""
    max_braking: Annotated[float | None, Advanced] = None
    """hardest braking of the adversary, unless its log has more [m/s^2]; 0: as --driving says"""
    max_lateral_accel: Annotated[float | None, Advanced] = None
    """highest lateral acceleration of the adversary, unless its log has more [m/s^2]; 0: as --driving says"""
    max_jerk: Annotated[float | None, Advanced] = None
    """highest jerk of the adversary, unless its log has more [m/s^3]; 0: as --driving says"""

    def config(self, rules: SearchRules) -> "AttackConfig":
        """The preset with what was given in its place."""
        from regents_cosim.attacks.presets import preset, road_users

        kinds = None if self.adversary_kinds is None else road_users(self.adversary_kinds)
        return preset(**(vars(self) | {"adversary_kinds": kinds}), **vars(rules))


@Parameter(name="*", group=BASELINE)
@dataclass(frozen=True)
class BaselineOptions:
    """Whether the planner got worse than a baseline allows."""

    baseline: Path | None = None
    """baseline.json of accepted outcomes: exit code 1 where the planner collides and did not before, or fails"""
    update: bool = False
    """accept what the planner does now, and say what changed (default file: baseline.json in the suite)"""
    fail: str = ""
    """fail on metrics that get worse as well, e.g. "min_ttc_s:-5% collision:+0": how far each may fall or rise"""
    strict: bool = False
    """fail on improvements that are not accepted yet"""
    margin: bool = False
    """measure how little of an attack makes the planner collide (up to six more drives per case, in the mirror)"""
    markdown: Annotated[Path | None, Parameter(allow_leading_hyphen=True)] = None
    """file for a summary that a pull request can show; - for stdout, in place of the table"""


@Parameter(name="*", group=TRAINING)
@dataclass(frozen=True)
class FineTune:
    """Learning from crashes, and the cases that tell whether it helped."""

    finetune: Path | None = None
    """a suite of attacked cases: of those that the weights crash in and could have passed, they learn to; begins with
    the shipped weights (or --resume), keeps as much of what was learnt as ordinary traffic bears, and prints scores
    before and after"""
    evading: Annotated[float | None, Parameter(validator=Number(gte=0.0, lte=1.0))] = None
    """share of the lessons and drives that are of these; 0.4"""
    held_out: Path | None = None
    """another suite of attacked cases for the scores; default every fifth window of the first, which is not taught
    (of the rest another fifth, to choose the weights by)"""
    ordinary: Path | None = None
    """recorded cases for the scores; default every fifth of those to train on, which is not taught"""


@Parameter(name="*", group=TRAINING)
@dataclass(frozen=True)
class AdversarialRounds:
    """Rounds of attack and training: what is attacked, how long, and where the crashes go."""

    adversarial: Annotated[int | None, Parameter(validator=Number(gte=1, lte=1000))] = None
    """number of rounds: attack the planner in fresh windows, let it learn from the crashes that a careful driver avoids
    and that it can see coming, and attack what it has become; a round whose weights drive ordinary traffic worse than
    those at the beginning does not count. The same command goes on after a stop"""
    nets: Networks = ()
    windows: Annotated[Count, OfTraffic] = 24
    """windows of each network that are attacked in each round"""
    held_out_windows: Annotated[Count, OfTraffic] = 24
    """windows of each network, with a seed of their own, in which both sets of weights are attacked at the end"""
    first_seed: Annotated[Seed, OfTraffic] = 1
    """seed of SUMO in the first round; each round takes the next one, and the comparison at the end the one after"""
    method: Annotated[Literal["focused", "regents", "king"], OfSearch] = "focused"
    """method of the attack, as in `regents attack`"""
    into: Annotated[Path | None, OfOutput] = None
    """a suite that grows by the crashes of new kinds that the rounds find; default OUTPUT.rounds/suite"""
    neighbours: Switch = True
    """teach the scene of each crash as well with so little of the attack left that nothing is to be feared"""
    verify: Verify = True
    pictures: Pictures = True

    def settings(self, training: "TrainConfig") -> "Rounds":
        """All that decides the rounds. Raises RegentsError."""
        from regents_cosim.attacks.presets import preset
        from regents_cosim.cases.shipped import NETWORKS
        from regents_cosim.evaluation.training.rounds_settings import REPLAN_EVERY, Rounds

        return Rounds(
            rounds=self.adversarial or 1,
            nets=self.nets or NETWORKS,
            windows=self.windows,
            held_out=self.held_out_windows,
            first_seed=self.first_seed,
            attack=preset(self.method, replan_every=REPLAN_EVERY),
            training=training,
            neighbours=self.neighbours,
            verify=self.verify,
        )


@Parameter(name="*", group=TRAINING)
@dataclass(frozen=True)
class TrainOptions:
    """How long, from what and how fast the network learns; what is not given is what the way to learn has.

    --adversarial has what --finetune has.
    """

    epochs: Count | None = None
    """passes; the learning rate falls to a hundredth over them; 40, or 8 with --finetune"""
    lessons: Count | None = None
    """new ones per epoch; each is repeated in four epochs; 4096, or 2048 that are repeated to the end with
    --finetune"""
    drives: CountOrZero | None = None
    """drives of the network by itself per epoch, from whose states it learns as well; 40, or 24 with --finetune"""
    frozen: CountOrZero | None = None
    """first layers of the encoder that learn no more, for a warm start; an epoch costs half with 4, a quarter with
    8; 0, or 4 with --finetune"""
    learning_rate: Annotated[float | None, Parameter(validator=Number(gt=0.0, lte=10.0))] = None
    """learning rate of Adam at the first epoch; 1e-3, or 5e-4 with --finetune"""
    teacher: Literal["log", "idm", "careful"] | None = None
    """log: every vehicle near an ego shows how to drive; idm: an IDM in the ego's place that sees no further than the
    view, which can tell what to do wherever the network has got to by itself; careful: the same, but it brakes fully
    while the careful driver of UN R157 would expect to meet another in view, and three tenths of the lessons are such
    steps; idm with --finetune, else log"""
    target: Literal["end", "route"] | None = None
    """goal that the network drives to: end: where its log ends; route: a point of its route 20 m ahead, and it is shown
    the lights of its own way alone, which is taught with all of them red and all green besides (needs --teacher idm);
    as the weights of --resume have it, else end"""
    view: Annotated[float | None, Parameter(validator=Number(gt=0.0))] = None
    """distance that the network sees ahead, behind and to each side [m], in as many pixels, so at the same cost; as the
    weights of --resume have it, else 19.2 as in the papers"""
    threads: Annotated[Count, Advanced] = 2
    """number of threads of torch"""
    seed: Seed = 0
    """random seed of everything that is drawn"""

    def config(self, from_crashes: bool, evading: float | None) -> "TrainConfig":
        """The settings of training or of learning from crashes, with what was given in their place."""
        from regents_cosim.planners.aim_bev.train_config import FINE_TUNING, TrainConfig

        given = vars(self) | {"evading": evading}
        known = {name: value for name, value in given.items() if value is not None}
        return replace(FINE_TUNING if from_crashes else TrainConfig(), **known)


@Parameter(name="*", group=ADVANCED)
@dataclass(frozen=True)
class ProgramOptions:
    """What becomes of the programs that are compiled on the way."""

    compile_cache: Switch = True
    """keep compiled programs on disk (folder: $REGENTS_CACHE)"""

    def keep(self) -> None:
        """Keep them from now on, if that is not turned off, here and in processes that this one starts."""
        from regents_cosim.mirror.compile_cache import OFF, keep_compiled_programs

        if not self.compile_cache:
            os.environ["REGENTS_CACHE"] = OFF
        keep_compiled_programs()


@Parameter(name="*", group=OUTPUT)
@dataclass(frozen=True)
class OutputOptions:
    """How results are shown."""

    quiet: bool = False
    """no progress, only the result"""
    json: bool = False
    """print the result as JSON"""
    wide: bool = False
    """every column of a table, even where the terminal is too narrow for them"""
    verbose: Annotated[bool, Parameter(["--verbose", "-v"])] = False
    """say on stderr what is done, case by case, and how long it takes, in place of progress bars"""
    log_file: Path | None = None
    """file to which the same is added, with times"""


# A case or a folder of cases, also `shipped:standard`.
Cases = Annotated[Path, Parameter(converter=_located)]
SumoOptions = Annotated[tuple[str, ...], Parameter("--sumo-option", show=False, allow_leading_hyphen=True)]
