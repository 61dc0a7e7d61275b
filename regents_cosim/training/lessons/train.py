"""Train AIM-BEV from recorded traffic (`regents train aim-bev`); the only module that imports torch for training."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Array, Float, Int
from torch import Tensor

from regents_cosim.errors import RegentsError, require
from regents_cosim.mirror.programs.jax_settings import each_in_float32
from regents_cosim.planners.aim_bev.camera import Camera
from regents_cosim.planners.aim_bev.network_inputs import AS_IN_THE_PAPERS, NetworkInputs
from regents_cosim.planners.aim_bev.route_ahead import all_red_and_all_green
from regents_cosim.planners.aim_bev.weights_file import load_weights, save_weights
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.training.lessons.classroom import Lesson, gather
from regents_cosim.training.lessons.curriculum import evading_steps, plan
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
    network, given, saved = _begun(config, resume)
    training = _Training(network, given, config, scenarios, crashes)
    if saved is not None and not crashes:
        training.restore(saved)

    def saved_epochs() -> list[Epoch]:
        weights = network.arrays() | given.marks()
        save_weights(weights, output)
        if not crashes:
            save_weights(training.checkpoint(weights), checkpoint_path(output))
        return list(training.done)

    if len(training.done) >= config.epochs:  # the checkpoint has them all
        yield saved_epochs()
    for epoch in range(len(training.done), config.epochs):
        training.run_epoch(epoch, drives=resume is not None or epoch >= config.warm_up)
        yield saved_epochs()


@each_in_float32
def drive_all(scenarios: Sequence[Scenario], weights: Path) -> Iterator[Tracks]:
    """The tracks of `scenarios` with egos driven by AIM-BEV with `weights`, many at once (in a quarter of the time).

    Raises RegentsError where the horizons differ, or the file holds no weights.
    """
    network, given, _ = _begun(TrainConfig(teacher="idm"), weights)
    room, predict, at_once = gather(scenarios, given), _predict(network), min(_AT_ONCE, len(scenarios))
    for first in range(0, len(scenarios), at_once):
        scene = np.minimum(np.arange(first, first + at_once), len(scenarios) - 1)  # the last chunk keeps the shape
        driven = np.stack([known for _, known in drive(room, predict, scene)], axis=-1)
        yield from map(_with_ego, scenarios[first : first + at_once], driven)


class _Training:
    """The network, the lessons that it is taught, and what a resumed run needs."""

    def __init__(
        self,
        network: AimBevNetwork,
        given: NetworkInputs,
        config: TrainConfig,
        scenarios: Sequence[Scenario],
        crashes: Sequence[Scenario],
    ) -> None:
        """`given` are the inputs of the network. Raises RegentsError where there are too few lessons."""
        self._network, self._config = network, config
        self._adam = torch.optim.Adam(network.parameters(), config.learning_rate)
        self._fine_tuning = bool(crashes)  # batch norms keep their statistics
        self.done: list[Epoch] = []
        self._met = ReachedStates.nothing()  # states reached in practice
        # states in which a careful teacher brakes for a coming danger, and equally many others
        self._urgent = ReachedStates.nothing()
        # lessons of the last epochs: first layers' output, speed, target, closed light, label
        self._known: deque[list[Tensor]] = deque(maxlen=config.kept)
        windows = [*scenarios, *(evaded(crash) for crash in crashes)]
        careful = config.teacher == "careful"
        by_log = [careful and scenario.attack is None for scenario in windows]
        window = [*range(len(windows))]
        if given.follows_route:
            twins = [(index, twin) for index, one in enumerate(scenarios) for twin in all_red_and_all_green(one)]
            window += [index for index, _ in twins]
            windows += [twin for _, twin in twins]
            by_log += [False for _ in twins]  # the others drove by other lights
        self._teacher = None  # the log teaches
        if config.teacher != "log":
            self._teacher = Teacher.of(windows, careful, given.camera, by_log)
        self._room = gather(windows, given)
        evasions = {len(scenarios) + index: evading_steps(crash) for index, crash in enumerate(crashes)}
        curriculum = plan(self._room, evasions, egos=self._teacher is not None)
        total = sum(map(len, curriculum.rows.values()))
        require(
            total >= config.batch, f"the cases hold {total} lessons, expected at least {config.batch}", RegentsError
        )
        self._taught, self._held_back = curriculum.split(np.array(window))

    def run_epoch(self, epoch: int, drives: bool) -> None:
        """Train one more epoch; `drives` lets the network drive by itself before."""
        rng = np.random.default_rng((self._config.seed, epoch))
        driven = self._practise(rng) if drives and self._config.drives else (None, None)
        if self._config.teacher == "careful":  # on the logs there are few states in which it brakes
            self._keep_urgent(ReachedStates(*self._taught.anywhere(_ELSEWHERE * self._config.lessons, rng)), rng)
        self._known.append(self._prepare(rng))
        loss = self._teach(rng, epoch)
        self.done.append(Epoch(epoch, loss, self._check(), *driven))

    def _prepare(self, rng: np.random.Generator) -> list[Tensor]:
        self._network.eval()
        parts = []
        with torch.inference_mode():
            for _ in range(self._config.lessons // self._config.batch):
                parts.append(self._columns(self._lessons(rng)))
        return [torch.cat(columns).clone() for columns in zip(*parts, strict=True)]

    def _teach(self, rng: np.random.Generator, epoch: int) -> float:
        """Make one pass over the kept lessons; returns the mean loss [m]."""
        network, batch = self._network.train(not self._fine_tuning), self._config.batch
        network.encoder.features[: self._config.frozen].eval().requires_grad_(False)
        columns = [torch.cat(parts) for parts in zip(*self._known, strict=True)]
        batches = len(columns[0]) // batch
        order = torch.from_numpy(rng.permutation(len(columns[0]))[: batches * batch].reshape(batches, -1))
        order = order.to(_DEVICE)
        losses = []
        for number, chosen in enumerate(order):
            *given, label = (column[chosen] for column in columns)
            self._set_rate(epoch + number / batches)
            loss = (self._finish(*given) - label).abs().mean()
            self._adam.zero_grad()
            loss.backward()
            self._adam.step()
            losses.append(loss.detach())  # without waiting for a GPU
        return torch.stack(losses).mean().item()

    def _set_rate(self, epoch: float) -> None:
        share = float(0.5 * (1.0 + np.cos(np.pi * epoch / self._config.epochs)))
        for group in self._adam.param_groups:
            group["lr"] = self._config.learning_rate * (0.01 + 0.99 * share)

    def _lessons(self, rng: np.random.Generator) -> Lesson:
        lesson = self._taught.draw(self._config.batch, rng, self._config.evading)
        if not len(self._met) and not len(self._urgent):
            return lesson
        rows = np.stack([lesson.scene, lesson.agent, lesson.step], axis=-1)
        own = np.stack([np.asarray(v) for v in (lesson.state.x, lesson.state.y, lesson.state.yaw, lesson.state.speed)])
        drawn = self._met.drawn_into(ReachedStates(rows, own.T), _FROM_PRACTICE, rng)
        drawn = self._urgent.drawn_into(drawn, self._config.urgent, rng)
        return self._taught.lessons(drawn.rows, drawn.states, rng)

    def _columns(self, lesson: Lesson) -> tuple[Tensor, ...]:
        """The output of the first layers for views, with speeds, targets, lights and labels, of a batch of lessons."""
        room, frozen = self._room, self._config.frozen
        labels = self._teacher.labels(room, lesson) if self._teacher else room.labels(lesson)
        found = (room.views(lesson), lesson.state.speed, room.targets(lesson), room.closed_lights(lesson), labels)
        begun, *others = map(_tensor, found)
        if frozen:
            begun = self._network.encoder.begin(_pictures(begun), frozen).half()
        return begun, *others

    def _finish(self, begun: Tensor, *known: Tensor) -> Tensor:
        """Waypoints [m] from the output of the first layers for views, and speeds, targets and lights."""
        network, frozen = self._network, self._config.frozen
        begun = begun.float().contiguous(memory_format=torch.channels_last) if frozen else _pictures(begun)
        with torch.autocast(_DEVICE.type, torch.bfloat16, enabled=_DEVICE.type == "cuda"):
            features = network.encoder.finish(begun, frozen)
        return network.plan(features.float(), *known)

    def _check(self) -> float:
        """The loss [m] on windows that are not taught, with the same lessons in every epoch."""
        config, errors = self._config, []
        rng = np.random.default_rng(config.seed)
        self._network.eval()
        with torch.inference_mode():
            for _ in range(max(min(_CHECKED, config.lessons) // config.batch, 1)):
                *given, label = self._columns(self._held_back.draw(config.batch, rng, config.evading))
                errors.append((self._finish(*given) - label).abs().mean().item())
        return float(np.mean(errors))

    def _practise(self, rng: np.random.Generator) -> tuple[float, float]:
        """Let the network drive, keep the states it reached, and return its collision rate and distance to the log
        [m].
        """
        config, taught = self._config, self._taught
        scenes = np.unique(np.concatenate([rows[:, 0] for rows in taught.rows.values()]))
        fled = np.isin(scenes, list(taught.evasions))
        evading = round(config.evading * config.drives) if fled.any() else 0
        chosen = np.concatenate([_draw(scenes[fled], evading, rng), _draw(scenes[~fled], config.drives - evading, rng)])
        lost_m = LOST_M if self._teacher is None else np.inf
        found = practise(self._room, _predict(self._network), chosen, lost_m=lost_m)
        met = found.met[taught.worth_teaching(found.met.rows)]
        self._met += met
        self._keep_urgent(met, rng)
        return found.collision_rate, found.mean_away_m

    def _keep_urgent(self, met: ReachedStates, rng: np.random.Generator) -> None:
        """Keep states in which a careful teacher brakes for a coming danger, and equally many others."""
        if self._teacher is None or self._teacher.lanes is None or not len(met):
            return
        danger = np.zeros(len(met), bool)
        for first in range(0, len(met), _TOLD_AT_ONCE):
            those = np.minimum(np.arange(first, first + _TOLD_AT_ONCE), len(met) - 1)  # the last chunk keeps the shape
            lessons = self._taught.lessons(met.rows[those], met.states[those], rng)
            danger[those] = np.asarray(self._teacher.brakes(self._room, lessons))
        self._urgent += met.balanced(danger, rng)

    def checkpoint(self, weights: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The arrays to continue from: weights, Adam's moments, the epochs so far and the states reached."""
        saved = {f"network.{name}": values for name, values in weights.items()}
        for index, state in self._adam.state_dict()["state"].items():
            saved |= {f"adam.{index}.{name}": value.cpu().numpy() for name, value in state.items()}
        saved["epochs"] = np.array([[np.nan if v is None else v for v in asdict(e).values()] for e in self.done])
        saved |= {"rows": self._met.rows, "states": self._met.states}
        return saved | {"urgent.rows": self._urgent.rows, "urgent.states": self._urgent.states}

    def restore(self, saved: dict[str, np.ndarray]) -> None:
        """Continue from the arrays of a checkpoint; weights alone have nothing more to restore."""
        if "epochs" not in saved:
            return
        state: dict[int, dict[str, Tensor]] = {}
        for name, values in saved.items():
            if name.startswith("adam."):
                _, index, moment = name.split(".")
                state.setdefault(int(index), {})[moment] = torch.tensor(values)
        self._adam.load_state_dict({"state": state, "param_groups": self._adam.state_dict()["param_groups"]})
        self._met = ReachedStates(saved["rows"], saved["states"])
        if "urgent.rows" in saved:
            self._urgent = ReachedStates(saved["urgent.rows"], saved["urgent.states"])
        for epoch, loss, held_back, *driven in saved["epochs"].tolist():
            rate, away = (None if np.isnan(value) else value for value in driven)
            self.done.append(Epoch(int(epoch), loss, held_back, rate, away))


def _begun(
    config: TrainConfig, resume: Path | None
) -> tuple[AimBevNetwork, NetworkInputs, dict[str, np.ndarray] | None]:
    """The network before the training, its inputs, and the arrays of the file to resume from."""
    network, given, saved = AimBevNetwork(), AS_IN_THE_PAPERS, None
    network.to(_DEVICE, memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
    if resume is not None:
        saved = load_weights(resume)
        weights = {name.removeprefix("network."): v for name, v in saved.items() if not name.startswith("adam.")}
        given = NetworkInputs.to(weights)
        known = network.state_dict()
        missing = [name for name in known if name not in weights and not name.endswith("num_batches_tracked")]
        require(not missing, f"the file to resume from lacks {len(missing)} weights, {missing[:1]} first", RegentsError)
        read = {name: torch.tensor(weights[name]).float() for name in known if name in weights}
        network.load_state_dict(read, strict=False)
    if config.target is not None:
        given = replace(given, follows_route=config.target == "route")
    if config.view is not None:
        given = replace(given, camera=Camera.reaching(config.view))
    require(
        not given.follows_route or config.teacher != "log",
        "weights that follow the route (target route), expected the teacher idm: the log tells nothing of lights",
        RegentsError,
    )
    return network, given, saved


def _tensor(values: Array) -> Tensor:
    """A JAX array as a torch tensor on torch's device; the memory is shared if possible."""
    return torch.from_dlpack(values).to(_DEVICE)


def _pictures(views: Tensor) -> Tensor:
    """Views as inputs of the network, in the memory layout that is fastest in torch."""
    return (views.float() / 255.0).permute(0, 3, 1, 2)


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
