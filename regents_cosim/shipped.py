"""Where the networks and scenarios that come with the package lie, installed or in a checkout."""

from pathlib import Path

from regents_cosim.errors import RegentsError

NETWORKS = ("merge", "crossing", "signals", "roundabout", "grid", "multilane")


def shipped(folder: str) -> Path:
    """`sumo_nets` or `scenarios`: inside the wheel, or beside the package in an editable install."""
    package = Path(__file__).parent
    for place in (package / folder, package.parent / folder):
        if place.is_dir():
            return place
    raise RegentsError(f"{folder} not found beside {package} (is the installation complete?)")


def network_config(name: str) -> Path:
    """The .sumocfg of a shipped network."""
    if name not in NETWORKS:
        raise RegentsError(f"network {name!r} does not exist, expected one of {', '.join(NETWORKS)}")
    return shipped("sumo_nets") / name / f"{name}.sumocfg"
