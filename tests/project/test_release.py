"""What belongs to a release fits together."""

import re
import tomllib
from importlib.metadata import version

from places import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_the_version_is_that_of_the_project_file():
    stated = PROJECT["project"]["version"]
    assert version("regents_cosim") == stated
    assert re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)[1] == stated
    first = re.search(r"^## \[?([\w.]+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1]
    assert first in ("Unreleased", stated)


def test_what_the_source_package_is_to_hold_is_there():
    for name in PROJECT["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]:
        assert (ROOT / name).exists(), name


def test_containers_and_workflows_install_the_libraries_that_the_error_names():
    from regents_cosim.simulators.sumo.process import _DEBIAN_PACKAGES

    for name in ("Dockerfile", "docs/crash-tests.yml"):
        assert _DEBIAN_PACKAGES in (ROOT / name).read_text()


def test_the_nightly_workflow_hands_on_what_its_attack_adds():
    workflow = (ROOT / "docs" / "crash-tests.yml").read_text()
    nightly = workflow[workflow.index("  new-cases:") :]
    attack = re.search(r"regents attack .* --into (\S+) -o (\S+)", nightly)
    artefact = re.search(r"name: new-cases\n +path: \|\n((?: {12}\S+\n?)+)", nightly)
    assert set(artefact[1].split()) == set(attack.groups())


def test_what_runs_suites_in_pytest_is_an_extra_that_every_installation_takes():
    wanted = {re.split("[><=]", one)[0] for one in PROJECT["project"]["optional-dependencies"]["test"]}
    assert wanted == {"pytest", "pytest-xdist"}
    for name in ("Makefile", "docs/tutorial.md"):
        assert "'.[test]'" in (ROOT / name).read_text(), name
    for name in ("README.md", "Dockerfile", "docs/crash-tests.yml"):
        assert "[test]" in (ROOT / name).read_text(), name
