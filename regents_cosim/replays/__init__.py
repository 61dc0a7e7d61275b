"""Replays Scenarios in the simulators that people use. A replay knows nothing of attacks or sources."""

from regents_cosim.planners.bridges import BRIDGES

# Planners that need a simulator of their own.
BRIDGES |= {
    "highway": "regents_cosim.replays.highway.ego:HighwayEgo",
    "sumo": "regents_cosim.replays.sumo.ego:SumoEgo",
}
