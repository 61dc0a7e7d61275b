"""Reads what SUMO is to simulate: a .sumocfg, or a network with routes, without its outputs.

Configurations of cities write logs, trip infos and detector counts into their folder. Only the traffic matters here, so
SUMO gets no option and no element of a file unless it is known to write nothing (`words`), and the folder stays
unchanged.
"""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from xml.sax.saxutils import quoteattr

from regents_cosim.cases.shipped import ALL_NETWORKS, located, names
from regents_cosim.checks.arguments import as_path, as_several
from regents_cosim.checks.ranges import Range
from regents_cosim.checks.xml_input import walk
from regents_cosim.errors import SumoError, require_file
from regents_cosim.plain_text import listed
from regents_cosim.simulators import ANY_EGO
from regents_cosim.simulators.sumo.files import ShownFiles, Survey, exists, is_xml, survey
from regents_cosim.simulators.sumo.options import NamedOptions, as_value, is_on, options_of_config, typed_options
from regents_cosim.simulators.sumo.process import in_sumo_process
from regents_cosim.simulators.sumo.words import (
    FILES_OF_GUI,
    FILES_READ,
    NOWHERE,
    OF_ADDITIONAL,
    OF_NET,
    OF_ROUTES,
    OF_STATE,
    OPTIONS,
)

_LATEST_S = 1e9  # SUMO counts milliseconds
_TELEPORT, _TELEPORTS_S = "time-to-teleport", 300  # after that many seconds of waiting SUMO moves a vehicle on
_MOST_NAMED = 6  # most names in a message about what was taken away
# Asking for a battery output gives vehicles a battery, and vehicles with a battery look for charging stations.
_BATTERY = "battery-output"
# Parameters of a vehicle that name a file for a device's output.
_DEVICES_WRITE = {"device.ssm.file": NOWHERE}


@dataclass(frozen=True)
class SumoInput:
    """The traffic to simulate, in SUMO's terms. Values given here override those of the configuration."""

    config: Path | None = None  # .sumocfg (-c)
    net: Path | None = None  # network (-n)
    routes: tuple[Path, ...] = ()  # route files (-r)
    additional: tuple[Path, ...] = ()  # additional files (-a)
    begin_s: float | None = None  # [s] start of the simulation (-b)
    end_s: float | None = None  # [s] end of the simulation (-e)
    extra: tuple[str, ...] = ()  # further options of SUMO's command line, which override all else
    ego: str = ANY_EGO  # id of the egos' vehicle, vehicle type or flow; auto: drawn by the seed

    def __post_init__(self) -> None:
        """Texts become paths, a single file a tuple of one. Raises RegentsError."""
        for name in ("config", "net"):
            if (path := getattr(self, name)) is not None:
                object.__setattr__(self, name, as_path(path, name))
        for name in ("routes", "additional"):
            object.__setattr__(self, name, tuple(as_path(one, name) for one in as_several(getattr(self, name))))
        object.__setattr__(self, "extra", as_several(self.extra))
        if self.begin_s is not None:
            Range(0.0, _LATEST_S, "seconds at which the simulation begins").check("`begin`", self.begin_s)
        if self.end_s is not None:
            Range(-1.0, _LATEST_S, "seconds at which the simulation ends, or -1 for no end").check("`end`", self.end_s)


@dataclass(frozen=True)
class SumoOptions:
    """The merged options of a configuration and the command line, with absolute paths."""

    file: Path  # the file that names the traffic: the configuration, the routes, or the network
    net: Path
    routes: tuple[Path, ...]
    additional: tuple[Path, ...]
    others: dict[str, str]  # options of the configuration, without those that write
    typed: dict[str, str]  # options of the command line, which may write
    read: dict[str, tuple[Path, ...]]  # files of other options that SUMO reads
    files: Survey  # all files that SUMO reads, except the network, and what they would write
    taken: tuple[str, ...]  # options of the configuration that were removed because they write

    def says(self, name: str) -> str:
        """The value of an option as given; empty where it was not given."""
        return self.typed.get(name, self.others.get(name, ""))

    def is_on(self, name: str) -> bool:
        """Whether a boolean option is on; False where it was not given."""
        return is_on(self.says(name))

    def turned_off(self) -> str:
        """One line on the outputs that are turned off; empty where there are none."""
        found = Counter(dict.fromkeys(self.taken, 1))
        for one in self.files.values():
            found.update(one.taken)
        named = [name if times == 1 else f"{name} ({times} times)" for name, times in found.items()]
        off = f"turned off, so that SUMO writes nothing beside {self.file.name}: {listed(named, _MOST_NAMED)}"
        return off if named else ""


def read_input(given: SumoInput) -> SumoOptions:
    """Merge a configuration, as SUMO reads it, with the options given beside it.

    Raises RegentsError where a file is missing, broken or would exhaust SUMO's memory, or no network is named.
    """
    given = replace(given, config=given.config and located(given.config))
    config = _read_config(given.config) if given.config else NamedOptions({}, {})
    typed = in_sumo_process(typed_options, given.extra) if given.extra else NamedOptions({}, {})
    others = {name: value for name, value in config.values.items() if name in OPTIONS}
    for name, time_s in (("begin", given.begin_s), ("end", given.end_s)):
        if time_s is not None:
            others[name] = f"{time_s:.10g}"
    beside = {OF_NET: [given.net] if given.net else [], OF_ROUTES: given.routes, OF_ADDITIONAL: given.additional}
    read = {name: paths for name, paths in config.files.items() if name in FILES_READ}
    read |= {name: tuple(path.absolute() for path in paths) for name, paths in beside.items() if paths}
    read |= {name: paths for name, paths in typed.files.items() if name in FILES_READ}
    written = {name: as_value(paths) for name, paths in typed.files.items() if name not in FILES_READ}
    nets, routes, additional = (read.pop(name, ()) for name in (OF_NET, OF_ROUTES, OF_ADDITIONAL))
    if len(nets) != 1:
        raise SumoError(
            f"{given.config or 'SUMO input'}: {len(nets) or 'no'} network{'s' * (len(nets) > 1)} named (expected one: "
            "<net-file> in the configuration, or -n)"
        )
    (net,) = nets
    for what, paths in (("SUMO network", (net,)), ("route file", routes), ("additional file", additional)):
        for path in paths:
            require_file(path, what)
    # Files of other options are plain data, of which none writes; the network has its own reader.
    survey(path for name, paths in read.items() if name != OF_STATE for path in paths if exists(path) and is_xml(path))
    return SumoOptions(
        given.config or (routes or (net,))[0],
        net,
        routes,
        additional,
        others=others,
        typed=typed.values | written,
        read=read,
        files=survey([*routes, *additional, *read.get(OF_STATE, ())]),
        taken=_that_write(config),
    )


def write_config(options: SumoOptions, folder: Path, forced: dict[str, str], defaults: dict[str, str]) -> Path:
    """Write a configuration to `folder` with which SUMO writes only what the command line asks for.

    `forced` options replace those of the configuration, `defaults` fill in missing ones.
    """
    shown = ShownFiles(options.files, folder)
    traffic = {OF_NET: (options.net,), OF_ROUTES: options.routes, OF_ADDITIONAL: options.additional}
    files = {name: paths for name, paths in (traffic | options.read).items() if paths}
    read = {name: as_value([shown.of(path) for path in paths]) for name, paths in files.items()}
    nowhere = _DEVICES_WRITE | ({_BATTERY: NOWHERE} if _BATTERY in options.taken else {})
    values = defaults | options.others | nowhere | forced | read | options.typed
    lines = [f"<{name} value={quoteattr(value)}/>" for name, value in values.items()]
    path = folder / "recording.sumocfg"
    path.write_text("\n".join(["<configuration>", *lines, "</configuration>"]), encoding="utf-8")
    return path


def other_traffic(options: SumoOptions, forced: dict[str, str], defaults: dict[str, str]) -> str:
    """A message about options of `write_config` that change the traffic of a configuration; empty where none does."""
    named = {_TELEPORT: f"SUMO's own {_TELEPORTS_S}"} | options.others
    here = defaults | options.others | forced | options.typed
    changed = [
        f"{name} {here[name]} (not {value})"
        for name, value in named.items()
        if not (name in options.typed or _equal(here.get(name, value), value))
    ]
    return (
        f"{options.file.name}: SUMO runs here with {', '.join(changed)}, so its traffic is not the same"
        if changed
        else ""
    )


def _equal(one: str, other: str) -> bool:
    try:
        return float(one) == float(other)
    except ValueError:  # a word
        return one == other or (one == "true" and is_on(other))


# --- the configuration file ---------------------------------------------------------------------


def _read_config(path: Path) -> NamedOptions:
    """The options of a configuration, as SUMO reads them: whatever its root element is called."""
    if not path.exists():
        raise SumoError(
            f"SUMO configuration not found: {path} (check the path; networks that come with regents_cosim: "
            f"{', '.join(names(ALL_NETWORKS))})"
        )
    walk(path, "SUMO configuration", SumoError, lambda tag, _: None)
    try:
        return in_sumo_process(options_of_config, path)
    except SumoError as error:
        raise SumoError(f"{path}: {error} (expected a plain configuration, as `sumo -c` reads it)") from error


def _that_write(config: NamedOptions) -> tuple[str, ...]:
    """The options of a configuration that make SUMO write files, in their order; console options are not among them.

    The value of some is no file's name, as it may be a prefix.
    """
    files = (name for name in config.files if name not in FILES_READ | FILES_OF_GUI)
    values = (
        name
        for name in config.values
        if name not in OPTIONS
        and (name.startswith("save-state.") or name in _DEVICES_WRITE or name.endswith("-output"))
    )
    return (*files, *values)
