"""Settings of a live attack: how often it plans, and how far it looks ahead."""

from dataclasses import dataclass

from regents_cosim.attacks.descent.search import LOOKED_AT
from regents_cosim.attacks.methods.presets import METHODS, AttackConfig
from regents_cosim.checks.ranges import Range
from regents_cosim.errors import RegentsError

LIVE = "-live"  # ends the name of a preset for live searches, whose settings differ from those of `regents attack`
HORIZON_S = 8.0  # default: the length of the windows that `regents attack` searches

_STARTS, _ITERATIONS = LOOKED_AT, 15  # as many starts as offline, but few iterations, since another search follows soon
_LEARNING_RATE = 5e-3  # so that few iterations get as far as the median of 75 offline
_RANGES = {
    "replan_s": Range(0.05, 60.0, "seconds from one plan to the next"),
    "horizon_s": Range(2.0, 60.0, "seconds that are planned ahead, and kept of a crash"),
    "radius_m": Range(10.0, 1e4, "metres around the ego"),
}


@dataclass(frozen=True)
class LiveSettings:
    """Settings of a live attack. Raises RegentsError for invalid values."""

    replan_s: float = 0.5
    horizon_s: float = HORIZON_S
    radius_m: float = 100.0
    judged: bool = True  # whether kept cases are judged
    seed: int = 0

    def __post_init__(self) -> None:
        for name, allowed in _RANGES.items():
            allowed.check(name, getattr(self, name))


def live_config(method: str | AttackConfig, samples: bool = True) -> AttackConfig:
    """The preset for live searches, such as `focused-live`: `focused` by one candidate at a time, with few starts and
    few iterations; `samples` allows sampling. A name without `-live` is understood. Raises RegentsError for others.
    """
    if isinstance(method, AttackConfig):
        return method
    preset = METHODS.get(method.removesuffix(LIVE))
    if preset is None or not preset.descends:
        expected = ", ".join(f"{name}{LIVE}" for name in ("focused", "regents", "king"))
        raise RegentsError(f"method {method!r}, expected one of {expected} (or an AttackConfig)")
    sampling = {"attempts": 1 + preset.tries.samples} if samples else {"attempts": 1, "patience": 0, "near_m": 0.0}
    return preset.but(
        method=f"{preset.method}{LIVE}",
        search="per-candidate",
        starts=min(preset.tries.starts, _STARTS),
        iterations=_ITERATIONS,
        learning_rate=_LEARNING_RATE,
        adversary_kinds=("vehicle",),
        **sampling,
    )
