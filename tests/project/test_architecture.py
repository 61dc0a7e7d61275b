"""The rules of the code that no linter knows."""

import ast
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from short_searches import SHORT

import regents_cosim

PACKAGE = Path(regents_cosim.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))
LIBSUMO_DOOR = PACKAGE / "simulators/sumo/process.py"
OBJECT_DOOR = PACKAGE / "planners/hosting/object_transport.py"
TRACI_DOORS = {"live/adversary.py", "live/host/reading.py", "live/host/vehicle_route.py"}
ENVIRONMENTS = {"__init__", "highway_host", "inject", "live_adversary", "sumo_replay"}
HIGHWAY_DOORS = {
    "sources/highway.py",
    "replays/highway/gym.py",
    "replays/highway/replay.py",
    *(f"envs/{name}.py" for name in ENVIRONMENTS),
    *(f"simulators/highway/{name}.py" for name in ("agents", "cast", "environments", "foresight", "net", "road")),
}
TORCH_DOORS = {
    *(PACKAGE / "planners/hosting").glob("torch_*.py"),
    *(PACKAGE / "training" / "lessons" / name for name in ("train.py", "torch_network.py")),
    PACKAGE / "simulators/highway/policy_files.py",
}


def imports_of(path: Path) -> set[str]:
    """Top-level names of all modules that a file imports, wherever in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add((node.module or "").partition(".")[0])
    return found


def rooms_named_in(path: Path) -> set[str]:
    """Rooms of the package that a file names in a string, as `module` or `module:attribute`."""
    nodes = (node.value for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Constant))
    names = {value for value in nodes if isinstance(value, str) and value.startswith("regents_cosim.")}
    rooms = {name.partition(":")[0].split(".")[1] for name in names}
    return {room for room in rooms - {""} if (PACKAGE / room).is_dir() or (PACKAGE / f"{room}.py").is_file()}


def names_in(path: Path) -> set[str]:
    return {node.id for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Name)}


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports(path):
    found = imports_of(path)
    assert "libsumo" not in found or path == LIBSUMO_DOOR, "libsumo is imported by simulators.sumo.process alone"
    is_highway_door = path.relative_to(PACKAGE).as_posix() in HIGHWAY_DOORS
    assert is_highway_door or not found & {"highway_env", "gymnasium", "pygame"}, "highway-env has few doors"
    is_traci_door = path.relative_to(PACKAGE).as_posix() in TRACI_DOORS
    assert "traci" not in found or is_traci_door, "who attaches to a running simulation alone asks TraCI"
    assert "pickle" not in found, "no pickle"
    assert "cloudpickle" not in found or path == OBJECT_DOOR, "objects of the user's leave the process by one door"
    assert "torch" not in found or path in TORCH_DOORS, (
        "torch trains and drives what is written in it, all else does without"
    )


def test_no_room_is_crowded():
    """But for readers of logs, which are as many as formats, and of one kind."""
    folders = Counter(path.parent.relative_to(PACKAGE).as_posix() for path in MODULES if path.name != "__init__.py")
    crowded = {folder for folder, modules in folders.items() if modules > 15} - {"sources/logs/readers"}
    assert not crowded, f"more than 15 modules, so part them into rooms: {crowded}"


def test_no_room_names_a_module_of_another_in_a_string():
    """Such a module would be imported past the layers, where no linter sees it."""
    found = {path.relative_to(PACKAGE).as_posix(): rooms_named_in(path) for path in MODULES}
    strangers = {name: rooms - {Path(name).parts[0]} for name, rooms in found.items()}
    assert {name: rooms for name, rooms in strangers.items() if rooms} == {}


@pytest.mark.parametrize("path", [p for p in MODULES if {"mirror", "attacks"} & set(p.parts)], ids=lambda p: p.name)
def test_the_mirror_and_the_attack_are_pure(path):
    assert not imports_of(path) & {"time", "random", "datetime"}
    if path.name != "compile_cache.py":
        assert not names_in(path) & {"open", "print"}


def fresh(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_importing_the_package_loads_nothing_heavy():
    heavy = "{'jax', 'equinox', 'libsumo', 'highway_env', 'gymnasium', 'scipy', 'shapely', 'numpy', 'rich', 'PIL'}"
    assert (
        fresh(f"import sys, regents_cosim, regents_cosim.cli.application; print({heavy} & set(sys.modules))") == "set()"
    )


@pytest.mark.slow
def test_every_process_knows_the_planners_of_simulators():
    code = "from regents_cosim.planners.find import find_attribute; "
    assert (
        fresh(code + "print(callable(find_attribute('sumo')), callable(find_attribute('highway:idm')))") == "True True"
    )


@pytest.mark.slow
def test_attacking_and_evaluating_load_what_they_use():
    unused = "{'scipy', 'cmaes', 'torch', 'highway_env', 'gymnasium', 'PIL', 'polars'}"
    modules = "regents_cosim.attacks.attack, regents_cosim.evaluation.drives.driving, regents_cosim.verdicts.judge"
    assert fresh(f"import sys, {modules}; print({unused} & set(sys.modules))") == "set()"


@pytest.mark.slow
def test_a_run_from_sumo_to_pictures_takes_little_of_scipy(tmp_path):
    code = "import sys; from regents_cosim.cli import run; "
    words = ["attack", "-c", "shipped:crossing", "--count", "1", "--quiet", "-o", str(tmp_path / "suite")]
    code += f"run({words + [f'--{name}={value}' for name, value in SHORT.items()]}); "
    code += "print({'scipy.spatial', 'scipy.ndimage'} & set(sys.modules))"  # JAX itself asks for scipy.linalg
    assert fresh(code).endswith("\nset()")


@pytest.mark.slow
def test_public_names_exist_whatever_was_imported_before():
    code = "import types, regents_cosim.attacks.descent.costs, regents_cosim; "
    code += "print([n for n in regents_cosim.__all__ if isinstance(getattr(regents_cosim, n), types.ModuleType)])"
    assert fresh(code) == "[]"


def test_an_unknown_name():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        regents_cosim.nothing  # noqa: B018


def test_the_map_for_contributors_names_every_room():
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    rows = [line for line in (PACKAGE.parent / "CONTRIBUTING.md").read_text().splitlines() if line.startswith("| `")]
    named = [room for row in rows for room in re.findall(r"`(\w+)/`", row.split("|")[1])]
    assert sorted(named) == sorted(rooms)
