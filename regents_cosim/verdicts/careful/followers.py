"""Tells which followers run into the back of a reference driver although they brake for it.

The drive of a reference driver is tried among the tracks of the case, in which no vehicle brakes for it. A follower
that runs into its back there may be able to brake in time; so the others drive again, and brake as in the mirror.
"""

import numpy as np

from regents_cosim.mirror.reacting_traffic import among_reacting, those_who_brake
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.careful.ego_path import EgoPositions
from regents_cosim.verdicts.careful.others_around import OthersAround


def still_rear_ended_by(attacked: Scenario, drive: EgoPositions, adversary: int) -> tuple[str, ...]:
    """Ids of the road users that run into the back of the ego on this drive although they brake for it."""
    agents, until = attacked.agents, attacked.tracks.steps
    ego = tuple(values[:until] for values in (drive.x, drive.y, drive.yaw, drive.speed))
    moved = among_reacting(attacked, ego, those_who_brake(attacked))
    met = OthersAround(attacked, adversary, moved).met_by(drive)
    return tuple(agents[index].id for index in np.flatnonzero(met.from_behind).tolist())
