"""`regents train aim-bev`: recorded traffic in, weights out. The only door to torch."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from regents_cosim.errors import RegentsError, require
from regents_cosim.planners.aim_bev.controller import Controller
from regents_cosim.planners.aim_bev.curriculum import KINDS, Curriculum, plan
from regents_cosim.planners.aim_bev.lessons import Classroom, gather
from regents_cosim.planners.aim_bev.practice import practise
from regents_cosim.planners.aim_bev.torch_network import AimBevNetwork
from regents_cosim.planners.aim_bev.weights_file import load_weights, save_weights
from regents_cosim.scenario import Scenario

_FROM_PRACTICE = 0.4  # share of the lessons, once there is any


@dataclass(frozen=True)
class TrainConfig:
    """How long and how fast to learn."""

    epochs: int = 40
    seed: int = 0
    lessons: int = 8192  # per epoch
    batch: int = 64
    learning_rate: float = 1e-3  # of Adam; falls to a hundredth of it along a cosine
    warm_up: int = 2  # epochs before the network drives by itself
    drives: int = 48  # of the network by itself, per epoch
    threads: int = 1  # of torch; one more renders views

    def __post_init__(self) -> None:
        for name in ("epochs", "lessons", "batch", "threads"):
            require(getattr(self, name) >= 1, f"{name} {getattr(self, name)}, expected at least 1", RegentsError)


@dataclass(frozen=True)
class Epoch:
    """How an epoch went."""

    epoch: int
    loss_m: float  # mean absolute error of the waypoints' coordinates
    held_back_m: float  # the same on windows that are not taught
    practice_collision_rate: float | None
    practice_away_m: float | None  # from the log


@dataclass
class _Course:
    """Everything that a resumed run needs."""

    network: AimBevNetwork
    adam: torch.optim.Adam
    done: list[Epoch]
    rows: Int[np.ndarray, "lesson 3"]  # states met in practice
    states: Float[np.ndarray, "lesson 4"]


def train(
    scenarios: Sequence[Scenario], output: Path, config: TrainConfig, resume: Path | None = None
) -> Iterator[Epoch]:
    """Teach the network epoch by epoch; the weights and a checkpoint are written after each.

    `resume` goes on from a checkpoint, or from weights alone (a warm start). The same scenarios,
    configuration and machine give the same weights. Raises RegentsError where the scenarios hold
    too few lessons.
    """
    torch.set_num_threads(config.threads)
    torch.manual_seed(config.seed)
    room = gather(scenarios)
    curriculum = plan(room)
    total = sum(map(len, curriculum.rows.values()))
    require(total >= config.batch, f"the cases hold {total} lessons, expected at least {config.batch}", RegentsError)
    taught, held_back = _split(curriculum)
    course = _begin(config, resume)
    for epoch in range(len(course.done), config.epochs):
        rng = np.random.default_rng((config.seed, epoch))
        driven = (None, None)
        if epoch >= config.warm_up and config.drives:
            driven = _practise(course, room, taught, rng, config)
        loss = _teach(course, room, taught, rng, config, epoch)
        check = _check(course, room, held_back, config)
        course.done.append(Epoch(epoch, loss, check, *driven))
        save_weights(_weights(course.network), output)
        _save_checkpoint(course, output)
        yield course.done[-1]


def checkpoint_path(output: Path) -> Path:
    """Where the checkpoint of a training lies that writes its weights to `output`."""
    return output.with_suffix(".checkpoint.safetensors")


def _split(curriculum: Curriculum) -> tuple[Curriculum, Curriculum]:
    """Every tenth window is held back."""
    taught = {kind: rows[rows[:, 0] % 10 != 9] for kind, rows in curriculum.rows.items()}
    held_back = {kind: rows[rows[:, 0] % 10 == 9] for kind, rows in curriculum.rows.items()}
    if not all(len(rows) for rows in held_back.values()):
        held_back = {kind: held_back[kind] if len(held_back[kind]) else taught[kind] for kind in KINDS}
    return (
        Curriculum(taught, curriculum.last, curriculum.log),
        Curriculum(held_back, curriculum.last, curriculum.log),
    )


def _teach(
    course: _Course, room: Classroom, taught: Curriculum, rng: np.random.Generator, config: TrainConfig, epoch: int
) -> float:
    """One epoch; returns the mean loss [m]."""
    batches = config.lessons // config.batch
    total = batches * config.epochs
    losses = []
    course.network.train()
    with ThreadPoolExecutor(1) as ahead:  # the next views are rendered while these are learnt from
        waiting = ahead.submit(_batch, course, room, taught, rng, config.batch)
        for index in range(batches):
            view, speed, target, label = waiting.result()
            if index + 1 < batches:
                waiting = ahead.submit(_batch, course, room, taught, rng, config.batch)
            done = (epoch * batches + index) / total
            for group in course.adam.param_groups:
                group["lr"] = config.learning_rate * (0.01 + 0.99 * 0.5 * (1.0 + np.cos(np.pi * done)))
            loss = (course.network(view, speed, target) - label).abs().mean()
            course.adam.zero_grad()
            loss.backward()
            course.adam.step()
            losses.append(loss.item())
    return float(np.mean(losses))


def _batch(
    course: _Course, room: Classroom, taught: Curriculum, rng: np.random.Generator, count: int
) -> tuple[Tensor, ...]:
    """Views, speeds, targets and labels of `count` lessons."""
    lesson = taught.draw(count, rng)
    if len(course.rows):
        met = rng.random(count) < _FROM_PRACTICE
        drawn = rng.integers(len(course.rows), size=count)
        rows = np.where(met[:, None], course.rows[drawn], np.stack([lesson.scene, lesson.agent, lesson.step], axis=-1))
        own = np.stack([np.asarray(v) for v in (lesson.state.x, lesson.state.y, lesson.state.yaw, lesson.state.speed)])
        lesson = taught.lessons(rows, np.where(met[:, None], course.states[drawn], own.T), rng)
    speed, target, label = (np.array(v) for v in (lesson.state.speed, room.targets(lesson), room.labels(lesson)))
    return _pictures(np.asarray(room.views(lesson))), *map(torch.from_numpy, (speed, target, label))


def _pictures(views: np.ndarray) -> Tensor:
    """Views as the network takes them; their memory layout is the one that torch is fastest with."""
    return torch.from_numpy(views.astype(np.float32) / 255.0).permute(0, 3, 1, 2)


def _check(course: _Course, room: Classroom, held_back: Curriculum, config: TrainConfig) -> float:
    """Loss [m] on windows that are not taught, the same lessons in every epoch."""
    lesson = held_back.draw(256, np.random.default_rng(config.seed))
    found = _predict(course.network)(
        np.asarray(room.views(lesson)), np.asarray(lesson.state.speed), np.asarray(room.targets(lesson))
    )
    return float(np.abs(found - np.asarray(room.labels(lesson))).mean())


def _practise(
    course: _Course, room: Classroom, taught: Curriculum, rng: np.random.Generator, config: TrainConfig
) -> tuple[float, float]:
    """Let the network drive, keep the states that it met, return its collision rate and distance to the log."""
    scenes = np.unique(np.concatenate([rows[:, 0] for rows in taught.rows.values()]))
    chosen = rng.choice(scenes, config.drives, replace=len(scenes) < config.drives)
    found = practise(room, _predict(course.network), Controller(), chosen)
    course.rows = np.concatenate([course.rows, found.rows])
    course.states = np.concatenate([course.states, found.states])
    return found.collision_rate, found.mean_away_m


def _predict(network: AimBevNetwork):  # noqa: ANN202
    def predict(views: np.ndarray, speed: np.ndarray, target: np.ndarray) -> np.ndarray:
        network.eval()
        with torch.inference_mode():
            parts = [
                network(_pictures(views[i : i + 64]), torch.tensor(speed[i : i + 64]), torch.tensor(target[i : i + 64]))
                for i in range(0, len(views), 64)
            ]
        return torch.cat(parts).numpy()

    return predict


def _begin(config: TrainConfig, resume: Path | None) -> _Course:
    network = AimBevNetwork().to(memory_format=torch.channels_last)
    adam = torch.optim.Adam(network.parameters(), config.learning_rate)
    course = _Course(network, adam, [], np.zeros((0, 3), int), np.zeros((0, 4)))
    if resume is not None:
        _restore(course, load_weights(resume))
    return course


def _weights(network: AimBevNetwork) -> dict[str, np.ndarray]:
    return {
        name: values.detach().numpy() for name, values in network.state_dict().items() if values.is_floating_point()
    }


def _save_checkpoint(course: _Course, output: Path) -> None:
    """Weights, Adam's moments, the epochs so far and the states met in practice."""
    saved = {f"network.{name}": values for name, values in _weights(course.network).items()}
    for index, state in course.adam.state_dict()["state"].items():
        saved |= {f"adam.{index}.{name}": np.asarray(value) for name, value in state.items()}
    saved["epochs"] = np.array([[np.nan if v is None else v for v in asdict(e).values()] for e in course.done])
    saved |= {"rows": course.rows, "states": course.states}
    save_weights(saved, checkpoint_path(output))


def _restore(course: _Course, saved: dict[str, np.ndarray]) -> None:
    own = {name.removeprefix("network."): torch.tensor(v) for name, v in saved.items() if not name.startswith("adam.")}
    known = course.network.state_dict()
    missing = [name for name in known if name not in own and not name.endswith("num_batches_tracked")]
    require(not missing, f"the file to resume from lacks {len(missing)} weights, {missing[:1]} first", RegentsError)
    course.network.load_state_dict({name: own[name].float() for name in known if name in own}, strict=False)
    if "epochs" not in saved:
        return
    count = len(course.adam.param_groups[0]["params"])
    state = {
        i: {name: torch.tensor(saved[f"adam.{i}.{name}"]) for name in ("step", "exp_avg", "exp_avg_sq")}
        for i in range(count)
    }
    course.adam.load_state_dict({"state": state, "param_groups": course.adam.state_dict()["param_groups"]})
    course.rows, course.states = saved["rows"], saved["states"]
    course.done = [
        Epoch(int(row[0]), *(None if np.isnan(v) else float(v) for v in row[1:])) for row in saved["epochs"]
    ]
