"""Places where recordings are held against SUMO's own log of the same run, and how: for tests, and for the table."""

import re
import subprocess
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

from comparison import Comparison, compare_with_fcd
from made_networks import MADE, make_network
from places import DATA, ROOT, own_copy

from regents_cosim.scenario.scenario import Scenario
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import Windows

INPUTS = ROOT / "tests" / "faithful" / "inputs"
SEED = 3
USUAL = ("--lanechange.duration", "3")
SAME_M, SAME_DEG = 0.01, 0.1
REPORTED = ("01-vehicle-gone-after-a-turn", "03-no-internal-links")
SHIPPED = (
    "crossing", "merge", "signals", "roundabout", "grid", "multilane", "lane_drop", "exit_lane", "town", "street",
)  # fmt: skip
GAMES = ("A10KW", "cross", "grid6", "square", "ramp", "corridor", "DRT", "fkk_in")
CITIES = (
    "bologna_acosta", "bologna_acosta_persontrips", "mcity", "wildau", "resco_arterial4x4", "resco_cologne1",
    "resco_cologne3",
)  # fmt: skip


class NoPlaceError(Exception):
    """A place that is not on this machine."""


def reported(name: str, folder: Path) -> "Held":
    """A small file that somebody reported."""
    (config,) = (INPUTS / name).glob("*.sumocfg")
    return held(config, folder)


def shipped_network(name: str, folder: Path) -> "Held":
    """A network that comes with the package."""
    return held(ROOT / "sumo_nets" / name / f"{name}.sumocfg", folder, end_s=120.0)


def made(name: str, folder: Path) -> "Held":
    """A network and traffic of `made_networks`."""
    return held(make_network(MADE[name], folder), folder, MADE[name].sumo)


def game(name: str, folder: Path) -> "Held":
    """A game of SUMO's."""
    import sumo as wheel

    config = Path(wheel.SUMO_HOME) / "tools" / "game" / f"{name}.sumocfg"
    if not config.is_file():
        raise NoPlaceError(f"this version of SUMO has no {config.name}")
    return held(own_copy(config, folder), folder, end_s=120.0)


def city(name: str, folder: Path) -> "Held":
    """A city of the folder of recordings."""
    configs = sorted((DATA / "sumo" / name).glob("*.sumocfg"))
    if not configs:
        raise NoPlaceError(f"no {DATA / 'sumo' / name} (REGENTS_DATA names the folder of recordings and cities)")
    begin = ElementTree.parse(configs[0]).getroot().find(".//begin")
    return held(
        own_copy(configs[0], folder), folder, end_s=(float(begin.get("value", 0)) if begin is not None else 0.0) + 120.0
    )


PLACES: dict[str, tuple[tuple[str, ...], Callable[[str, Path], "Held"]]] = {
    "networks of the package": (SHIPPED, shipped_network),
    "made by netgenerate": (tuple(MADE), made),
    "games of SUMO": (GAMES, game),
    "cities": (CITIES, city),
    "small files that others reported": (REPORTED, reported),
}


Held = tuple[list[Scenario], list[Comparison], Path]  # cases, how far each differs, and the log


def held(config: Path, folder: Path, sumo: tuple[str, ...] = (), count: int = 2, end_s: float | None = None) -> Held:
    """Record windows, and hold them against SUMO's own log of the same run; NoWindowError where there is none."""
    found = record_sumo(
        SumoInput(config, end_s=end_s, extra=sumo), Windows(count=count, seed=SEED, prefer="none"), tell=lambda _: None
    )
    log = own_log(config, folder, sumo, end_s)
    return found, compare_with_fcd(found, log), log


def own_log(config: Path, folder: Path, sumo: tuple[str, ...], until_s: float | None = None) -> Path:
    """SUMO's fcd-output of a run of the configuration, and beside it what its lights show."""
    import sumo as wheel

    log, additional = folder / "own.fcd.xml", folder / "lights.add.xml"
    additional.write_text(f'<additional><timedEvent type="SaveTLSStates" dest="{lights_of(log)}"/></additional>')
    named = ElementTree.parse(config).getroot().find(".//additional-files")
    files = [] if named is None else [str(config.parent / name) for name in re.split("[, ]+", named.get("value", ""))]
    taken = {word for word in sumo if word.startswith("--")}
    taken |= {"--lateral-resolution"} & {f"--{option.tag}" for option in ElementTree.parse(config).getroot().iter()}
    usual = USUAL if not taken & {"--lateral-resolution", "--lanechange.duration"} else ()
    words = [
        str(Path(wheel.SUMO_HOME) / "bin" / "sumo"), "-c", str(config), "--step-length", "0.1", "--seed", str(SEED),
        *(("--time-to-teleport", "-1") if "--time-to-teleport" not in taken else ()),
        "--random", "false", "--pedestrian.striping.walkingarea-detail", "32", *usual, *sumo,
        "--fcd-output", str(log), "--precision", "6",
        "--additional-files", ",".join([*files, str(additional)]), "--no-step-log", "--no-warnings",
        *(("--end", str(until_s)) if until_s is not None else ()),
    ]  # fmt: skip
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, cwd=folder)
    assert done.returncode == 0, done.stderr
    return log


def lights_of(log: Path) -> Path:
    return log.with_name("lights.xml")


def assert_same_lights(found: list[Scenario], log: Path) -> int:
    """Each light of a case at every step, against what SUMO saved; how many were compared."""
    shown = defaultdict(dict)
    if not lights_of(log).exists():  # SUMO writes none where there are no lights
        assert not any(case.signals for case in found)
        return 0
    for state in ElementTree.parse(lights_of(log)).getroot().iter("tlsState"):
        shown[state.get("id")][round(10 * float(state.get("time")))] = state.get("state")
    compared = 0
    for case in found:
        for signal in case.signals:
            for step in range(case.tracks.steps):
                at = round(10 * case.provenance.begin_s) + step
                if at in shown[signal.id]:
                    assert signal.letters(step) == shown[signal.id][at], (case.id, signal.id, step)
                    compared += 1
    assert compared or not any(case.signals for case in found)
    return compared


def differing(found: Held) -> list[str]:
    """The differences from SUMO's log, in words."""
    said = []
    for case, one in zip(found[0], found[1], strict=True):
        said += [f"{one.case}: {name} missing for {count} instants" for name, count in one.unexplained(case).items()]
        said += [f"{one.case}: {one.farthest} is {one.farthest_m:.3f} m off"] * (one.farthest_m > SAME_M)
        said += [f"{one.case}: {one.most_turned} turned {one.most_turned_deg:.3f} degrees"] * (
            one.most_turned_deg > SAME_DEG
        )
        said += [f"{one.case}: nothing to compare"] * (one.compared == 0)
    return said
