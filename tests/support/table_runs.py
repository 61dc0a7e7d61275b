"""Runs of a method on windows, made by hand for tables."""

from dataclasses import replace

import numpy as np
from scenes import scene

from regents_cosim.attack_record import AttackRecord, Collision
from regents_cosim.collisions import collision_type_of, first_contact
from regents_cosim.evaluation.crashes.scores import MethodRun
from regents_cosim.judgement import Fault, Flaw, Judgement, Law, ReferenceDrive

LAWFUL = Law((), ())
AVOIDS = (ReferenceDrive("careful", True, 1.0, 2.2),)
CRASHES = (ReferenceDrive("careful", False, 1.0, 2.2),)


def missed(name, outcome="no_collision"):
    made = scene((0, 0, 10), (60, 3.2, 10), name=name)
    return replace(made, attack=AttackRecord(name, "king", "idm", outcome, 3, candidates=("car01",)), log=made.tracks)


def crashed(name, flaws=(), law=None, drivers=(), at_fault="adversary"):
    """A cut-in that ends in a contact."""
    made = scene((0, 0, 10), (8, 3.2, 9), name=name)
    y = np.array(made.tracks.y)
    y[1] -= 3.2 * np.linspace(0, 1, 81) ** 2
    tracks = replace(made.tracks, y=y)
    agent, step = first_contact(made.agents, tracks)
    hit = Collision(
        "car01", step, 0.1 * step, collision_type_of(made.agents, tracks, agent, step), 4.0, attributed=True
    )
    agents = (made.agents[0], replace(made.agents[1], role="adversary"))
    judgement = Judgement(tuple(flaws), Fault(at_fault, "cut_in", "too close"), law, drivers)
    return replace(
        made,
        agents=agents,
        tracks=tracks,
        log=made.tracks,
        attack=AttackRecord(name, "king", "idm", "collision", 3, hit, ("car01",)),
        judgement=judgement,
    )


WINDOWS = [
    [missed("a", "already_colliding")],
    [crashed("b")],
    [crashed("c", [Flaw.OFF_ROAD]), crashed("c2", law=LAWFUL, drivers=CRASHES)],
    [crashed("d", [Flaw.OFF_ROAD])],
    [missed("e")],
]


KINGS = MethodRun("king", "idm", 500, WINDOWS, seconds=2.0)
