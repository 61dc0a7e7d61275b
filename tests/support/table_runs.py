"""Runs of a method on windows, made by hand for tables."""

from dataclasses import replace

import numpy as np
from scenes import crash, moved, scene

from regents_cosim.evaluation.crashes.scores import MethodRun
from regents_cosim.scenario.attack_record import AttackRecord
from regents_cosim.scenario.judgement import Fault, Flaw, Judgement, Law, ReferenceDrive

LAWFUL = Law((), ())
AVOIDS = (ReferenceDrive("careful", True, 1.0, 2.2),)
CRASHES = (ReferenceDrive("careful", False, 1.0, 2.2),)


def missed(name, outcome="no_collision"):
    made = scene((0, 0, 10), (60, 3.2, 10), name=name)
    return replace(made, attack=AttackRecord(name, "king", "idm", outcome, 3, candidates=("car01",)), log=made.tracks)


def crashed(name, flaws=(), law=None, drivers=(), at_fault="adversary"):
    """A cut-in that ends in a contact."""
    made = scene((0, 0, 10), (8, 3.2, 9), name=name)
    case = crash(made, moved(made, 1, y=3.2 * (1.0 - np.linspace(0, 1, 81) ** 2)))
    hit = replace(case.collision, relative_speed=4.0)
    judgement = Judgement(tuple(flaws), Fault(at_fault, "cut_in", "too close"), law, drivers)
    return replace(case, attack=replace(case.attack, collision=hit, candidates=("car01",)), judgement=judgement)


WINDOWS = [
    [missed("a", "already_colliding")],
    [crashed("b")],
    [crashed("c", [Flaw.OFF_ROAD]), crashed("c2", law=LAWFUL, drivers=CRASHES)],
    [crashed("d", [Flaw.OFF_ROAD])],
    [missed("e")],
]


KINGS = MethodRun("king", "idm", 500, WINDOWS, seconds=2.0)
