"""The package as others install it: a wheel, outside the repository."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder into which the built wheel was installed."""
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    build = ["wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(ROOT)]
    subprocess.run([*pip, *build], check=True)
    (wheel,) = folder.glob("*.whl")
    subprocess.run([*pip, "install", "--no-deps", "--target", str(folder / "site"), str(wheel)], check=True)
    return folder / "site"


def run(installed, code):
    return both(installed, code)[0]


def both(installed, code):
    """What it says on stdout and on stderr."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=installed.parent,
        env=os.environ | {"PYTHONPATH": str(installed)},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


@pytest.mark.slow
def test_networks_and_scenarios_come_with_it(installed):
    code = "from regents_cosim.cases.shipped import *; print(shipped('scenarios'), *map(network_config, ALL_NETWORKS))"
    paths = [Path(line) for line in run(installed, code).split()]
    assert len(paths) == 11
    assert all(path.exists() and path.is_relative_to(installed) for path in paths)


@pytest.mark.slow
def test_it_records_and_replays(installed):
    code = """
from regents_cosim import network_config, record, replay
case, = record(network_config("crossing"), count=1)
print(replay(case).verified)
"""
    assert run(installed, code).split() == ["True"]


@pytest.mark.slow
def test_what_comes_with_it_is_named_and_never_written_to(installed):
    code = """
from regents_cosim.cli import run
assert run(["record", "-c", "shipped:merge", "--count", "1", "-o", "recorded"]) == 0
assert run(["suite", "list", "--shipped"]) == 0
assert run(["suite", "check", "shipped:standard"]) == 0
assert run(["record", "-c", "sumo_nets/merge/merge.sumocfg", "-o", "other"]) == 2
assert run(["evaluate", "shipped:quickstart", "--planner", "idm", "--update"]) == 2
"""
    before = sorted(installed.rglob("*.json"))
    out, errors = both(installed, code)
    assert "shipped:quickstart" in out
    conflicts, missing, update = errors.splitlines()
    assert conflicts.startswith("windows in which another road user can lawfully cross or join the ego's path: ")
    assert "shipped:merge" in missing
    assert "--baseline" in update
    assert sorted(installed.rglob("*.json")) == before
