"""What SUMO is to simulate: a .sumocfg, or a network with routes, without its outputs.

City configurations write logs, trip infos and detector counts next to themselves. We only
look at the traffic, so every option and every detector that names an output is turned off and
the folder stays as it is. All other options reach SUMO unchanged.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path
from xml.sax.saxutils import quoteattr

from regents_cosim.cases.shipped import ALL_NETWORKS, located, names
from regents_cosim.checks.ranges import Range
from regents_cosim.errors import SumoError, require_file
from regents_cosim.sources.recording import ANY_EGO, STEP_S
from regents_cosim.sources.sumo_files import OUTPUT_ATTRIBUTES, exists
from regents_cosim.sources.xml_input import read_tree

_LATEST_S = 1e9  # SUMO counts milliseconds


@dataclass(frozen=True)
class SumoInput:
    """The traffic to simulate, in SUMO's own terms. What is given here goes before the configuration's."""

    config: Path | None = None  # -c
    net: Path | None = None  # -n
    routes: tuple[Path, ...] = ()  # -r
    additional: tuple[Path, ...] = ()  # -a
    begin_s: float | None = None  # -b
    end_s: float | None = None  # -e
    extra: tuple[str, ...] = ()  # further options as typed, the last word
    ego: str = ANY_EGO  # of the windows: a vehicle, a vehicle type or a flow

    def __post_init__(self) -> None:
        if self.begin_s is not None:
            Range(0.0, _LATEST_S, "seconds at which the simulation begins").check("--begin", self.begin_s)
        if self.end_s is not None:
            Range(-1.0, _LATEST_S, "seconds at which the simulation ends, or -1 for no end").check("--end", self.end_s)


@dataclass(frozen=True)
class SumoOptions:
    """Everything SUMO needs, with absolute paths: what a configuration and the command line come to."""

    file: Path  # what the traffic is known by: the configuration, the routes, or the network
    net: Path
    routes: tuple[Path, ...]
    additional: tuple[Path, ...]
    others: dict[str, str]
    extra: tuple[str, ...]


def read_input(given: SumoInput) -> SumoOptions:
    """Merge a configuration with what is given beside it.

    Raises RegentsError where a file is missing or broken, or no network is named.
    """
    given = replace(given, config=given.config and located(given.config))
    others = _read_config(given.config) if given.config else {}
    net = _paths(others.pop("net-file", ""))
    routes = _paths(others.pop("route-files", ""))
    additional = _paths(others.pop("additional-files", ""))
    for name, time_s in (("begin", given.begin_s), ("end", given.end_s)):
        if time_s is not None:
            others[name] = f"{time_s:.10g}"
    if given.net is None and not net:
        raise SumoError(
            f"{given.config or 'SUMO input'}: no network named (expected <net-file> in the configuration, or -n)"
        )
    options = SumoOptions(
        file=Path(),
        net=given.net.absolute() if given.net else net[0],
        routes=_absolute(given.routes) or routes,
        additional=_absolute(given.additional) or additional,
        others=others,
        extra=given.extra,
    )
    options = replace(options, file=given.config or (options.routes or (options.net,))[0])
    require_file(options.net, "SUMO network")
    for path in options.routes:
        require_file(path, "route file")
    for path in options.additional:
        require_file(path, "additional file")
    return options


def write_config(options: SumoOptions, folder: Path, forced: dict[str, str], defaults: dict[str, str]) -> Path:
    """A configuration without outputs in `folder`; `forced` options replace, `defaults` fill in."""
    additional = [_without_outputs(path, folder / f"{i}.add.xml") for i, path in enumerate(options.additional)]
    values = defaults | options.others | forced | {"net-file": str(options.net)}
    if options.routes:
        values["route-files"] = ",".join(map(str, options.routes))
    if additional:
        values["additional-files"] = ",".join(map(str, additional))
    lines = [f"<{name} value={quoteattr(value)}/>" for name, value in values.items()]
    path = folder / "recording.sumocfg"
    path.write_text("\n".join(["<configuration>", *lines, "</configuration>"]), encoding="utf-8")
    return path


def other_step(options: SumoOptions) -> str:
    """What is said of a configuration with another step than that of a recording; empty where it has the same."""
    named = options.others.get("step-length", str(STEP_S))
    if named.strip("0") == str(STEP_S).strip("0"):
        return ""
    return (
        f"{options.file.name} names a step of {named} s: SUMO runs at {STEP_S} s here, as recordings are made, so its "
        "traffic is not the same"
    )


# --- the configuration file ---------------------------------------------------------------------

_SYNONYMS = {
    "n": "net-file", "net": "net-file", "r": "route-files", "routes": "route-files",
    "a": "additional-files", "additional": "additional-files", "b": "begin", "e": "end",
}  # fmt: skip
_SECTIONS_DROPPED = {"output", "report", "gui_only", "traci_server"}
# Outputs, ways into a running SUMO, and what a recording decides itself.
_DROPPED = {
    "log", "l", "log-file", "message-log", "error-log", "netstate-dump", "netstate", "ndump", "summary", "tripinfo",
    "personinfo", "vehroutes", "personroutes", "person-fcd", "output-prefix", "output-suffix", "save-configuration",
    "C", "save-config", "save-template", "save-schema", "device.ssm.file", "device.toc.file",
    "pedestrian.jupedsim.wkt", "pedestrian.jupedsim.py", "remote-port", "num-clients", "gui-settings-file", "g",
    "configuration-file", "c", "configuration", "seed", "random",
}  # fmt: skip


def _read_config(path: Path) -> dict[str, str]:
    """Options of a configuration by their long names, paths absolute, outputs left out."""
    if not path.exists():
        raise SumoError(
            f"SUMO configuration not found: {path} (check the path; networks that come with regents_cosim: "
            f"{', '.join(names(ALL_NETWORKS))})"
        )
    root = read_tree(path, "SUMO configuration", SumoError)
    if root.tag not in ("configuration", "sumoConfiguration", "sumo-configuration"):
        raise SumoError(f"{path}: the root element is <{root.tag}>, expected a .sumocfg with <configuration>")
    dropped = {item for section in root if section.tag in _SECTIONS_DROPPED for item in section.iter()}
    found = {}
    for item in root.iter():
        value = item.get("value", item.get("v"))
        name = _SYNONYMS.get(item.tag, item.tag)
        if value is not None and value.strip() and item not in dropped and not _is_dropped(name):
            found[name] = _resolved(name, value.strip(), path.absolute().parent)
    return found


def _is_dropped(name: str) -> bool:
    return name in _DROPPED or name.startswith("save-state.") or "-output" in name or name.endswith(".output")


def _resolved(name: str, value: str, folder: Path) -> str:
    """`value` with the paths in it made absolute: options for files, and whatever names a file that exists."""
    names_files = name.endswith(("-file", "-files", ".file", ".files", "load-state"))
    parts = [part.strip() for part in value.split(",")]
    return ",".join(
        str(folder / part) if part and "$" not in part and (names_files or exists(folder / part)) else part
        for part in parts
    )


def _paths(value: str) -> tuple[Path, ...]:
    return tuple(Path(part) for part in value.split(",") if part)


def _absolute(paths: tuple[Path, ...]) -> tuple[Path, ...]:
    return tuple(path.absolute() for path in paths)


# --- additional files ---------------------------------------------------------------------------

_NOWHERE = "NUL"  # SUMO's name for it on every system


def _without_outputs(path: Path, copy: Path) -> Path:
    """`path` itself, or a copy that writes nothing where an element of it names an output."""
    root = read_tree(path, "additional file", SumoError)
    outputs = [e for e in root.iter() if e.tag in OUTPUT_ATTRIBUTES and OUTPUT_ATTRIBUTES[e.tag] in e.keys()]  # noqa: SIM118
    if not outputs:
        return path
    for element in root.iter():
        for name in ("file", "href", "imgFile"):
            if element.get(name):
                element.set(name, str(path.parent / str(element.get(name))))
    for element in outputs:
        element.set(OUTPUT_ATTRIBUTES[element.tag], _NOWHERE)
    ET.ElementTree(root).write(copy, encoding="utf-8")
    return copy
