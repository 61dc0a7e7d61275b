"""Replays Scenarios in the simulators that people use. A replay knows nothing of attacks or sources."""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from regents_cosim.planners.hosting.bridges import Factory


def _highway() -> Factory:
    from regents_cosim.replays.highway.ego import HighwayEgo

    return HighwayEgo


def _sumo() -> Factory:
    from regents_cosim.replays.sumo.ego import SumoEgo

    return SumoEgo


# Planners that need a simulator of their own, as in `planners.hosting.bridges`.
PLANNERS = {"highway": _highway, "sumo": _sumo}
