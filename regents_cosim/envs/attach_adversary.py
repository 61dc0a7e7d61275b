"""Attaches a live adversary to the SUMO of an environment, which runs in a separate process."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from regents_cosim.live.settings import LiveSettings, live_config
from regents_cosim.system.progress import DOING, shown


@dataclass(frozen=True)
class AttachAdversary:
    """Is sent to SUMO's process and called with the simulation; the returned function reports the adversary after each
    step.

    Raises RegentsError for invalid values.
    """

    method: str
    replan_s: float
    horizon_s: float = 5.0

    def __post_init__(self) -> None:
        LiveSettings(self.replan_s, self.horizon_s)
        live_config(self.method)

    def __call__(self, sumo: Any, ego: str) -> Callable[[], dict[str, Any]]:
        """Attach to the simulation, against an ego whose driver is unknown."""
        from regents_cosim.live import Adversary

        without_samples = live_config(self.method, samples=False)  # for many episodes
        adversary = Adversary(
            sumo, ego, "observed", without_samples, replan_s=self.replan_s, horizon_s=self.horizon_s, judged=False,
            tell=_nothing,
        )  # fmt: skip
        DOING.tell_once(shown(True).say)

        def watch() -> dict[str, Any]:
            adversary.step()
            return {"adversary": adversary.adversary or "", "attacks": adversary.tally.attacks}

        return watch


def _nothing(line: str) -> None:
    """Ignore messages; the episode goes on without them."""
