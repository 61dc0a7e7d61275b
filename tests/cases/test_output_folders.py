"""Results go where they do no harm to what was read."""

import shutil

import pytest

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import shipped
from regents_cosim.cases.suite import SuiteWriter
from regents_cosim.cli import run

QUICKSTART = shipped("scenarios") / "quickstart"


@pytest.fixture
def recorded(tmp_path):
    case = load_case(find_cases(QUICKSTART)[0]).before_attack()
    return SuiteWriter(tmp_path / "c1", 0).add(case)


def files(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(("of", "into"), [("c1", "c1"), ("c1", "c1/../c1"), ("c1/CASE", "c1"), ("c1/CASE", "c1/CASE")])
def test_attacked_cases_do_not_go_among_those_that_are_attacked(recorded, tmp_path, capsys, of, into):
    before = files(tmp_path)
    of, into = (str(tmp_path / path.replace("CASE", recorded.name)) for path in (of, into))
    assert run(["attack", of, "-o", into]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "choose another" in said
    assert files(tmp_path) == before


def test_a_case_alone_is_shrunk_into_a_folder_that_is_named(tmp_path, capsys):
    case = shutil.copytree(find_cases(QUICKSTART)[1], tmp_path / "alone")
    for file in (QUICKSTART / "maps").iterdir():
        shutil.copy(file, case)
    before = files(tmp_path)
    assert run(["shrink", str(case)]) == 2
    assert "name one with -o" in capsys.readouterr().err
    assert run(["shrink", str(case), "-o", str(case)]) == 2
    assert "is a case, expected a folder for cases" in capsys.readouterr().err
    assert files(tmp_path) == before
