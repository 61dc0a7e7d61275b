"""Sizes of the types of SUMO's logs, and lights that SUMO accepts."""

import re
import shutil
from pathlib import Path

import pytest
from params import slow
from places import ROOT

from regents_cosim.replays.replay import replay
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.simulators.sumo.types import read_types
from regents_cosim.sources.fcd import record_fcd
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import Windows

INPUTS = Path(__file__).parent / "inputs" / "08-types-of-an-fcd-log"


def sizes(log, routes):
    log, net, types = INPUTS / log, INPUTS / "net.net.xml", (INPUTS / routes,)
    found = record_fcd(log, net, Windows(count=3, prefer="none"), routes_or_types=types, tell=lambda _: None)
    return {agent.id: (agent.length, agent.width) for case in found for agent in case.agents}


@pytest.mark.parametrize(("log", "routes"), [("fcd-at.xml.gz", "r.rou.xml"), ("fcd-inc.xml.gz", "inc.rou.xml")])
def test_types_that_traci_changed_or_that_are_included_have_their_sizes(log, routes):
    assert sizes(log, routes)["h0"] == (6.2, 2.1)


def test_trams_and_trains_are_as_large_as_sumo_makes_them():
    found = sizes("fcd-trams.xml.gz", "r.rou.xml")
    assert (found["t0"], found["u0"]) == ((22.0, 2.4), (109.5, 3.0))


@pytest.mark.slow
def test_every_class_of_sumo_has_the_size_that_sumo_gives_it(tmp_path):
    import sumolib

    names = sorted(sumolib.net.lane.SUMO_VEHICLE_CLASSES)
    routes = tmp_path / "r.rou.xml"
    types = "".join(f'<vType id="{name}" vClass="{name}"/>' for name in names)
    routes.write_text(f"<routes>{types}</routes>")
    known = read_types((routes,))
    own = _sizes_in_sumo(routes, names)
    assert {name: (known[name].length, known[name].width) for name in names} == own


def _sizes_in_sumo(routes, names):
    from regents_cosim.system.workers import run_isolated

    return run_isolated(ask_sizes, (str(routes), tuple(names)))


def ask_sizes(job):
    from regents_cosim.simulators.sumo.process import running_sumo

    routes, names = job
    net = ROOT / "sumo_nets" / "merge" / "merge.net.xml"
    with running_sumo(["-n", str(net), "-r", routes, "--no-step-log", "true"]) as sumo:
        return {name: (sumo.vehicletype.getLength(name), sumo.vehicletype.getWidth(name)) for name in names}


@pytest.mark.slow
@pytest.mark.parametrize("more", [slow("r"), "rG"])
def test_lights_may_have_more_letters_than_links(more, tmp_path):
    """Common in networks edited by hand; SUMO takes them, so what is recorded there replays there."""
    shutil.copytree(ROOT / "sumo_nets" / "signals", tmp_path / "net")
    net = tmp_path / "net" / "signals.net.xml"
    text, changed = re.subn(r'(<phase[^>]*state="\w+)"', rf'\1{more}"', net.read_text())
    assert changed
    net.write_text(text)
    config = SumoInput(tmp_path / "net" / "signals.sumocfg", end_s=100.0)
    (case,) = record_sumo(config, Windows(count=1, seed=1, prefer="none"), tell=lambda _: None)
    assert any(signal.letters(0).endswith(more) for signal in case.signals)
    found = replay(case)
    assert found.verified, found.reason
