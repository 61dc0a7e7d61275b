"""What the README says is run as it stands there."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT
from quick_xla import as_users_have_it
from shipped_cases import crash_on
from short_searches import short_commands, short_script

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.cases.shipped import NETWORKS
from regents_cosim.replays.replay import replay_each

README = (ROOT / "README.md").read_text()
BIN = Path(sys.executable).parent


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def run(command, folder, variables=os.environ):
    environment = variables | {"PATH": f"{BIN}:{os.environ['PATH']}"}
    done = subprocess.run(command, shell=True, cwd=folder, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_first_commands_are_targets_of_the_makefile():
    first = blocks("bash")[0]
    assert [line.split("#")[0].strip() for line in first.splitlines()] == ["make demo", "make test"]
    for target in ("demo", "test"):
        run(f"make --dry-run {target}", ROOT)


@pytest.mark.slow
def test_a_planner_of_your_own(tmp_path):
    (planner,) = (block for block in blocks("python") if "my_planner.py" in block)
    assert len([line for line in planner.splitlines() if line.strip() and not line.startswith("#")]) <= 10
    (tmp_path / "my_planner.py").write_text(planner)
    (command,) = (line for block in blocks("bash") for line in block.splitlines() if "my_planner.py" in line)
    (tmp_path / "sumo_nets").symlink_to(ROOT / "sumo_nets")
    said = run(f"{command} --count 1 --no-pictures", tmp_path)
    assert "against my_planner.py:Cautious" in said


@pytest.mark.slow
def test_in_python(tmp_path):
    (example,) = (block for block in blocks("python") if "for attacked in attack" in block)
    (tmp_path / "example.py").write_text(short_script(example))
    said = run(f"{BIN}/python example.py", tmp_path).split()
    assert "collision" in said
    assert said.count("True") == said.count("collision")


@pytest.mark.slow
def test_on_your_own_traffic(tmp_path):
    """The commands as they stand there, `your.sumocfg` being the grid. What they run is compiled as for users."""
    net = ROOT / "sumo_nets" / "grid"
    for name in ("net.xml", "rou.xml", "sumocfg"):
        (tmp_path / f"grid.{name}").symlink_to(net / f"grid.{name}")
    (tmp_path / "your.sumocfg").symlink_to(net / "grid.sumocfg")
    (block,) = (block for block in blocks("bash") if "your.sumocfg --planner" in block)
    lines = [line.split("#")[0].strip() for line in block.splitlines() if line.startswith("regents")]
    run(short_commands(f"{lines[0]} --count 1"), tmp_path, as_users_have_it())
    case = load_manifest(tmp_path / "suite").cases[0].case
    for line in lines[1:]:
        run(line.replace("CASE", case), tmp_path, as_users_have_it())
    assert (tmp_path / "crash.gif").stat().st_size > 10_000


@pytest.mark.slow
def test_the_shipped_cases_crash_in_sumo():
    crashes = [load_case(crash_on(network)) for network in NETWORKS]
    assert all(case.judgement.telling for case in crashes)
    assert all(found.found is not None and found.verified for found in replay_each(crashes))
