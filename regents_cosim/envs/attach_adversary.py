"""A live adversary for the SUMO of an environment, which runs in a process of its own."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from regents_cosim.live.settings import LiveSettings, live_config
from regents_cosim.system.progress import DOING, shown


@dataclass(frozen=True)
class AttachAdversary:
    """Sent to SUMO's process, where it is given the simulation; what it returns says who attacks after each step.

    Raises RegentsError for values that cannot be meant.
    """

    method: str
    replan_s: float
    horizon_s: float = 5.0

    def __post_init__(self) -> None:
        LiveSettings(self.replan_s, self.horizon_s)
        live_config(self.method)

    def __call__(self, sumo: Any, ego: str) -> Callable[[], dict[str, Any]]:
        """Attach to the simulation, against an ego whose driver is not known."""
        from regents_cosim.live import Adversary

        without_samples = live_config(self.method, samples=False)  # many episodes are to be driven
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
    """The episode goes on without it."""
