"""Train AIM-BEV from recorded traffic (`regents train aim-bev`); the only module that imports torch for training."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Array, Float, Int
from torch import Tensor

from regents_cosim.errors import RegentsError, require
from regents_cosim.mirror.programs.jax_settings import each_in_float32
from regents_cosim.planners.aim_bev.camera import Camera
from regents_cosim.planners.aim_bev.controller import Controller
from regents_cosim.planners.aim_bev.network_inputs import AS_IN_THE_PAPERS, NetworkInputs
from regents_cosim.planners.aim_bev.route_ahead import all_red_and_all_green
from regents_cosim.planners.aim_bev.weights_file import load_weights, save_weights
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.training.lessons.classroom import Classroom, Lesson, gather
from regents_cosim.training.lessons.curriculum import Curriculum, evading_steps, plan
from regents_cosim.training.lessons.practice import LOST_M, Predict, ReachedStates, drive, practise
from regents_cosim.training.lessons.teacher import Teacher
from regents_cosim.training.lessons.torch_network import AimBevNetwork
from regents_cosim.training.lessons.train_config import Epoch, TrainConfig, checkpoint_path
from regents_cosim.verdicts.careful.evasion import evaded

_FROM_PRACTICE = 0.4  # share of the lessons, once there is any practice
_ELSEWHERE, _TOLD_AT_ONCE = 2, 256  # states far off the logs that are checked per lesson, and states checked at once
_CHECKED = 256  # held-back lessons per epoch
_AT_ONCE = 64  # drives, and pictures for the network, at once
_DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")


@dataclass
class _ResumableTraining:
    """The state that a resumed run needs."""

    network: AimBevNetwork
    adam: torch.optim.Adam
    done: list[Epoch]
    met: ReachedStates  # states reached in practice
    urgent: ReachedStates  # states in which a careful teacher brakes for a coming danger, and equally many others
    known: deque[list[Tensor]]  # lessons of the last epochs: first layers' output, speed, target, closed light, label
    teacher: Teacher | None  # None: the log teaches
    fine_tuning: bool  # batch norms keep their statistics
    given: NetworkInputs  # inputs of the network


@each_in_float32
def train(
    scenarios: Sequence[Scenario],
    output: Path,
    config: TrainConfig,
    resume: Path | None = None,
    crashes: Sequence[Scenario] = (),
) -> Iterator[list[Epoch]]:
    """Train the network epoch by epoch; yields the list of all epochs so far, including those before a resumption.

    The weights and a checkpoint are written after each epoch.

    `resume` continues from a checkpoint, or from weights alone (a warm start). Without interruption, the same
    scenarios, configuration and machine give the same weights; a resumed run begins with new lessons. Weights that
    follow the route are taught windows with lights three times: as recorded, all lights red, and all green. Raises
    RegentsError where the scenarios hold too few lessons, or their horizons differ.

    From `crashes` of the network in `resume`, each with a drive that avoids it, the network learns to evade. Its batch
    norms keep their statistics. Such a fine-tuning starts anew from a checkpoint, and writes none.
    """
    torch.set_num_threads(config.threads)
    torch.manual_seed(config.seed)
    course = _begin(config, resume, fine_tuning=bool(crashes))
    windows = [*scenarios, *(evaded(crash) for crash in crashes)]
    careful = config.teacher == "careful"
    by_log = [careful and scenario.attack is None for scenario in windows]
    window = [*range(len(windows))]
    if course.given.follows_route:
        twins = [(index, twin) for index, scenario in enumerate(scenarios) for twin in all_red_and_all_green(scenario)]
        window += [index for index, _ in twins]
        windows += [twin for _, twin in twins]
        by_log += [False for _ in twins]  # the others drove by other lights
    if config.teacher != "log":
        course.teacher = Teacher.of(windows, careful, course.given.camera, by_log)
    room = gather(windows, course.given)
    curriculum = plan(
        room,
        {len(scenarios) + index: evading_steps(crash) for index, crash in enumerate(crashes)},
        course.teacher is not None,
    )
    total = sum(map(len, curriculum.rows.values()))
    require(total >= config.batch, f"the cases hold {total} lessons, expected at least {config.batch}", RegentsError)
    taught, held_back = curriculum.split(np.array(window))
    yield from _epochs(course, room, taught, held_back, output, config, begun=resume is not None)


def _epochs(
    course: _ResumableTraining,
    room: Classroom,
    taught: Curriculum,
    held_back: Curriculum,
    output: Path,
    config: TrainConfig,
    begun: bool,
) -> Iterator[list[Epoch]]:
    """Train the remaining epochs; a network that has `begun` to learn before drives from the first epoch on."""
    for epoch in range(len(course.done), config.epochs):
        rng = np.random.default_rng((config.seed, epoch))
        driven = (None, None)
        if config.drives and (begun or epoch >= config.warm_up):
            driven = _practise(course, room, taught, rng, config)
        _look_elsewhere(course, room, taught, rng, config)
        course.known.append(_prepare(course, room, taught, rng, config))
        loss = _teach(course, rng, config, epoch)
        check = _check(course, room, held_back, config)
        course.done.append(Epoch(epoch, loss, check, *driven))
        save_weights(_weights(course), output)
        if not course.fine_tuning:
            _save_checkpoint(course, output)
        yield list(course.done)


@each_in_float32
def drive_all(scenarios: Sequence[Scenario], weights: Path) -> Iterator[Tracks]:
    """The tracks of `scenarios` with egos driven by AIM-BEV with `weights`, many at once (in a quarter of the time).

    Raises RegentsError where the horizons differ, or the file holds no weights.
    """
    begun, at_once = _begin(TrainConfig(teacher="idm"), weights), min(_AT_ONCE, len(scenarios))
    room, predict = gather(scenarios, begun.given), _predict(begun.network)
    for first in range(0, len(scenarios), at_once):
        scene = np.minimum(np.arange(first, first + at_once), len(scenarios) - 1)  # the last chunk keeps the shape
        driven = np.stack([known for _, known in drive(room, predict, Controller(), scene)], axis=-1)
        yield from map(_with_ego, scenarios[first : first + at_once], driven)


def _prepare(
    course: _ResumableTraining,
    room: Classroom,
    taught: Curriculum,
    rng: np.random.Generator,
    config: TrainConfig,
) -> list[Tensor]:
    """New lessons, as inputs of the first layer that learns."""
    course.network.eval()
    parts = []
    with torch.inference_mode():
        for _ in range(config.lessons // config.batch):
            parts.append(_columns(course, room, _lessons(course, taught, rng, config), config.frozen))
    return [torch.cat(columns).clone() for columns in zip(*parts, strict=True)]


def _teach(course: _ResumableTraining, rng: np.random.Generator, config: TrainConfig, epoch: int) -> float:
    """Make one pass over the kept lessons; returns the mean loss [m]."""
    network, frozen = course.network.train(not course.fine_tuning), config.frozen
    network.encoder.features[:frozen].eval().requires_grad_(False)
    columns = [torch.cat(parts) for parts in zip(*course.known, strict=True)]
    batches = len(columns[0]) // config.batch
    order = torch.from_numpy(rng.permutation(len(columns[0]))[: batches * config.batch].reshape(batches, -1))
    order = order.to(_DEVICE)
    losses = []
    for number, chosen in enumerate(order):
        *given, label = (column[chosen] for column in columns)
        _set_rate(course.adam, config, epoch + number / batches)
        loss = (_finish(network, frozen, *given) - label).abs().mean()
        course.adam.zero_grad()
        loss.backward()
        course.adam.step()
        losses.append(loss.detach())  # without waiting for a GPU
    return torch.stack(losses).mean().item()


def _set_rate(adam: torch.optim.Adam, config: TrainConfig, epoch: float) -> None:
    share = float(0.5 * (1.0 + np.cos(np.pi * epoch / config.epochs)))
    for group in adam.param_groups:
        group["lr"] = config.learning_rate * (0.01 + 0.99 * share)


def _lessons(course: _ResumableTraining, taught: Curriculum, rng: np.random.Generator, config: TrainConfig) -> Lesson:
    """A batch of lessons, some of them from states that egos reached."""
    lesson = taught.draw(config.batch, rng, config.evading)
    if not len(course.met) and not len(course.urgent):
        return lesson
    rows = np.stack([lesson.scene, lesson.agent, lesson.step], axis=-1)
    own = np.stack([np.asarray(v) for v in (lesson.state.x, lesson.state.y, lesson.state.yaw, lesson.state.speed)])
    drawn = course.met.drawn_into(ReachedStates(rows, own.T), _FROM_PRACTICE, rng)
    drawn = course.urgent.drawn_into(drawn, config.urgent, rng)
    return taught.lessons(drawn.rows, drawn.states, rng)


def _columns(course: _ResumableTraining, room: Classroom, lesson: Lesson, frozen: int) -> tuple[Tensor, ...]:
    """The output of the first layers for views, with speeds, targets, lights and labels, of a batch of lessons."""
    labels = course.teacher.labels(room, lesson) if course.teacher else room.labels(lesson)
    found = (room.views(lesson), lesson.state.speed, room.targets(lesson), room.closed_lights(lesson), labels)
    begun, *others = map(_tensor, found)
    if frozen:
        begun = course.network.encoder.begin(_pictures(begun), frozen).half()
    return begun, *others


def _finish(network: AimBevNetwork, frozen: int, begun: Tensor, *known: Tensor) -> Tensor:
    """Waypoints [m] from the output of the first layers for views, and speeds, targets and lights."""
    begun = begun.float().contiguous(memory_format=torch.channels_last) if frozen else _pictures(begun)
    with torch.autocast(_DEVICE.type, torch.bfloat16, enabled=_DEVICE.type == "cuda"):
        features = network.encoder.finish(begun, frozen)
    return network.plan(features.float(), *known)


def _tensor(values: Array) -> Tensor:
    """A JAX array as a torch tensor on torch's device; the memory is shared if possible."""
    return torch.from_dlpack(values).to(_DEVICE)


def _pictures(views: Tensor) -> Tensor:
    """Views as inputs of the network, in the memory layout that is fastest in torch."""
    return (views.float() / 255.0).permute(0, 3, 1, 2)


def _check(course: _ResumableTraining, room: Classroom, held_back: Curriculum, config: TrainConfig) -> float:
    """The loss [m] on windows that are not taught, with the same lessons in every epoch."""
    rng, errors = np.random.default_rng(config.seed), []
    course.network.eval()
    with torch.inference_mode():
        for _ in range(max(min(_CHECKED, config.lessons) // config.batch, 1)):
            lesson = held_back.draw(config.batch, rng, config.evading)
            *given, label = _columns(course, room, lesson, config.frozen)
            errors.append((_finish(course.network, config.frozen, *given) - label).abs().mean().item())
    return float(np.mean(errors))


def _practise(
    course: _ResumableTraining, room: Classroom, taught: Curriculum, rng: np.random.Generator, config: TrainConfig
) -> tuple[float, float]:
    """Let the network drive, keep the states it reached, and return its collision rate and distance to the log [m]."""
    scenes = np.unique(np.concatenate([rows[:, 0] for rows in taught.rows.values()]))
    fled = np.isin(scenes, list(taught.evasions))
    evading = round(config.evading * config.drives) if fled.any() else 0
    chosen = np.concatenate([_draw(scenes[fled], evading, rng), _draw(scenes[~fled], config.drives - evading, rng)])
    lost_m = LOST_M if course.teacher is None else np.inf
    found = practise(room, _predict(course.network), Controller(), chosen, lost_m=lost_m)
    worth = taught.worth_teaching(found.rows)
    met = ReachedStates(found.rows[worth], found.states[worth])
    course.met += met
    _keep_urgent(course, room, taught, met, rng)
    return found.collision_rate, found.mean_away_m


def _look_elsewhere(
    course: _ResumableTraining, room: Classroom, taught: Curriculum, rng: np.random.Generator, config: TrainConfig
) -> None:
    """Look for states far off the logs in which a careful teacher brakes, as there are few on the logs."""
    if config.teacher == "careful":
        _keep_urgent(course, room, taught, ReachedStates(*taught.anywhere(_ELSEWHERE * config.lessons, rng)), rng)


def _keep_urgent(
    course: _ResumableTraining, room: Classroom, taught: Curriculum, met: ReachedStates, rng: np.random.Generator
) -> None:
    """Keep states in which a careful teacher brakes for a coming danger, and equally many others."""
    if course.teacher is None or course.teacher.dangers is None or not len(met):
        return
    danger = np.zeros(len(met), bool)
    for first in range(0, len(met), _TOLD_AT_ONCE):
        those = np.minimum(np.arange(first, first + _TOLD_AT_ONCE), len(met) - 1)  # the last chunk keeps the shape
        found = course.teacher.brakes(room, taught.lessons(met.rows[those], met.states[those], rng))
        danger[those] = np.asarray(found)
    course.urgent += met.balanced(danger, rng)


def _draw(scenes: Int[np.ndarray, " scene"], count: int, rng: np.random.Generator) -> Int[np.ndarray, " drive"]:
    return rng.choice(scenes, count, replace=len(scenes) < count)


def _predict(network: AimBevNetwork) -> Predict:
    def predict(*shown: Array) -> np.ndarray:
        network.eval()
        with torch.inference_mode():
            chunks = zip(*(_tensor(values).split(_AT_ONCE) for values in shown), strict=True)
            return torch.cat([network(_pictures(view), *given) for view, *given in chunks]).cpu().numpy()

    return predict


def _with_ego(scenario: Scenario, driven: Float[np.ndarray, "4 time"]) -> Tracks:
    moved = {
        name: np.concatenate([ego[None].astype(float), getattr(scenario.tracks, name)[1:]])
        for name, ego in zip(("x", "y", "yaw", "speed"), driven, strict=True)
    }
    return replace(scenario.tracks, **moved, accel=None, curvature=None)


def _begin(config: TrainConfig, resume: Path | None, fine_tuning: bool = False) -> _ResumableTraining:
    network = AimBevNetwork()
    network.to(_DEVICE, memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
    adam = torch.optim.Adam(network.parameters(), config.learning_rate)
    course = _ResumableTraining(
        network, adam, [], ReachedStates.nothing(), ReachedStates.nothing(), deque(maxlen=config.kept), None,
        fine_tuning, AS_IN_THE_PAPERS,
    )  # fmt: skip
    if resume is not None:
        saved = load_weights(resume)
        _restore(course, {n: v for n, v in saved.items() if n != "epochs"} if fine_tuning else saved)
    if config.target is not None:
        course.given = replace(course.given, follows_route=config.target == "route")
    if config.view is not None:
        course.given = replace(course.given, camera=Camera.reaching(config.view))
    require(
        not course.given.follows_route or config.teacher != "log",
        "weights that follow the route (target route), expected the teacher idm: the log tells nothing of lights",
        RegentsError,
    )
    return course


def _weights(course: _ResumableTraining) -> dict[str, np.ndarray]:
    """The weights by name, with the arrays that state the inputs."""
    state = course.network.state_dict().items()
    found = {name: values.detach().cpu().numpy() for name, values in state if values.is_floating_point()}
    return found | course.given.marks()


def _save_checkpoint(course: _ResumableTraining, output: Path) -> None:
    """Write weights, Adam's moments, the epochs so far and the states reached in practice."""
    saved = {f"network.{name}": values for name, values in _weights(course).items()}
    for index, state in course.adam.state_dict()["state"].items():
        saved |= {f"adam.{index}.{name}": value.cpu().numpy() for name, value in state.items()}
    saved["epochs"] = np.array([[np.nan if v is None else v for v in asdict(e).values()] for e in course.done])
    saved |= {"rows": course.met.rows, "states": course.met.states}
    saved |= {"urgent.rows": course.urgent.rows, "urgent.states": course.urgent.states}
    save_weights(saved, checkpoint_path(output))


def _restore(course: _ResumableTraining, saved: dict[str, np.ndarray]) -> None:
    own = {name.removeprefix("network."): torch.tensor(v) for name, v in saved.items() if not name.startswith("adam.")}
    course.given = NetworkInputs.to({name: values.numpy() for name, values in own.items()})
    known = course.network.state_dict()
    missing = [name for name in known if name not in own and not name.endswith("num_batches_tracked")]
    require(not missing, f"the file to resume from lacks {len(missing)} weights, {missing[:1]} first", RegentsError)
    course.network.load_state_dict({name: own[name].float() for name in known if name in own}, strict=False)
    if "epochs" not in saved:
        return
    state: dict[int, dict[str, Tensor]] = {}
    for name, values in saved.items():
        if name.startswith("adam."):
            _, index, moment = name.split(".")
            state.setdefault(int(index), {})[moment] = torch.tensor(values)
    course.adam.load_state_dict({"state": state, "param_groups": course.adam.state_dict()["param_groups"]})
    course.met = ReachedStates(saved["rows"], saved["states"])
    if "urgent.rows" in saved:
        course.urgent = ReachedStates(saved["urgent.rows"], saved["urgent.states"])
    for epoch, loss, held_back, *driven in saved["epochs"].tolist():
        rate, away = (None if np.isnan(value) else value for value in driven)
        course.done.append(Epoch(int(epoch), loss, held_back, rate, away))
