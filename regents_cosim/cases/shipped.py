"""The SUMO networks and suites that come with the package, named as in `shipped:merge`."""

from pathlib import Path

from regents_cosim.checks.names import did_you_mean
from regents_cosim.errors import RegentsError

NETWORKS = ("merge", "crossing", "signals", "roundabout", "grid", "multilane")  # used where no network is named
WITH_PERSONS = ("town", "street")  # pedestrians and cyclists too; used only where named
NAMED_ONLY = ("lane_drop", "exit_lane")  # vehicles only, in no table of results; used only where named
ALL_NETWORKS = NETWORKS + NAMED_ONLY + WITH_PERSONS
SUITES = ("standard", "quickstart", "on_foot")
_PREFIX = "shipped:"


def shipped(folder: str) -> Path:
    """The folder `sumo_nets` or `scenarios`: in the wheel, or beside the package in an editable install."""
    package = Path(__file__).parents[1]
    for place in (package / folder, package.parent / folder):
        if place.is_dir():
            return place
    raise RegentsError(f"{folder} not found beside {package} (is the installation complete?)")


def network_config(name: str) -> Path:
    """The path of the .sumocfg of a shipped network, such as `merge`. Raises RegentsError for an unknown name."""
    if name not in ALL_NETWORKS:
        raise RegentsError(f"network {name!r} does not exist, {did_you_mean(name, ALL_NETWORKS)}")
    return shipped("sumo_nets") / name / f"{name}.sumocfg"


def networks() -> list[str]:
    """The shipped SUMO networks as `record` and `-c` take them, such as `shipped:merge`."""
    return names(ALL_NETWORKS)


def network(name: str) -> Path:
    """The path of the .sumocfg for `name`: a file, or a shipped network with or without `shipped:`."""
    return Path(name) if name.endswith(".sumocfg") else network_config(name.removeprefix(_PREFIX))


def suite_folder(name: str) -> Path:
    """The folder of a shipped suite."""
    if name not in SUITES:
        raise RegentsError(f"suite {name!r} does not exist, {did_you_mean(name, SUITES)}")
    return shipped("scenarios") / name


def located(path: Path) -> Path:
    """`path` itself, or for `shipped:NAME` the .sumocfg of a network, the folder of a suite or of a case in it."""
    if not str(path).startswith(_PREFIX):
        return path
    name, *case = Path(str(path).removeprefix(_PREFIX)).parts or ("",)
    if name in ALL_NETWORKS and not case:
        return network_config(name)
    if name in SUITES and ".." not in case:
        return suite_folder(name).joinpath(*case)
    known = (*SUITES, *ALL_NETWORKS)
    raise RegentsError(f"{path} does not exist, {did_you_mean(name, known, _PREFIX)}")


def as_named(path: Path) -> str:
    """How `path` is typed: what `located` found of a suite that comes with the package by its name."""
    for name in SUITES:
        if path.is_relative_to(place := shipped("scenarios") / name):
            return f"{_PREFIX}{Path(name) / path.relative_to(place)}"
    return str(path)


def names(of: tuple[str, ...]) -> list[str]:
    """The names with the prefix `shipped:`, as a user types them."""
    return [f"{_PREFIX}{name}" for name in of]


def is_own(path: Path) -> bool:
    """Whether `path` lies outside the installed package, in which nothing is written."""
    return not path.resolve().is_relative_to(Path(__file__).parents[1])


def require_own(path: Path, option: str) -> None:
    """Raise RegentsError where `path` lies in the installed package."""
    if not is_own(path):
        raise RegentsError(f"{path} is part of the installed package: name a place of your own with {option}")
