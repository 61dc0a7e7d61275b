"""Results go where they do no harm to what was read."""

import log_files
import pytest

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import shipped
from regents_cosim.cli import run
from regents_cosim.errors import CaseError
from regents_cosim.saving import SuiteWriter, save_unlisted

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


THEIRS = {"scenario.json": b'{"name": "a scenario of another tool"}\n', "tracks.npz": b"mine", "notes.md": b"mine"}


@pytest.mark.parametrize("names", [("scenario.json",), ("tracks.npz",), tuple(THEIRS)])
def test_what_somebody_else_has_in_the_place_of_a_case_stays(recorded, tmp_path, names):
    case = load_case(recorded)
    place = tmp_path / "theirs" / case.id
    place.mkdir(parents=True)
    for name in names:
        (place / name).write_bytes(THEIRS[name])
    for save in (SuiteWriter(tmp_path / "theirs", 0).add, lambda one: save_unlisted(one, tmp_path / "theirs")):
        with pytest.raises(CaseError, match=f"{names[0]} is of no case .*left as it is") as refused:
            save(case)
        assert "\n" not in str(refused.value)
    assert {path.name: path.read_bytes() for path in place.iterdir()} == {name: THEIRS[name] for name in names}
    assert not (tmp_path / "theirs" / "suite.json").exists()


def test_a_file_of_the_name_of_a_case_stays(recorded, tmp_path):
    case = load_case(recorded)
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / case.id).write_bytes(b"mine")
    with pytest.raises(CaseError, match="left as it is"):
        SuiteWriter(tmp_path / "theirs", 0).add(case)
    assert (tmp_path / "theirs" / case.id).read_bytes() == b"mine"


def test_cases_of_ours_are_replaced_whether_listed_or_readable_and_the_users_files_stay(recorded, tmp_path):
    case, suite = load_case(recorded), recorded.parent
    (recorded / "notes.md").write_bytes(b"mine")
    (recorded / "scenario.json").write_bytes(b"")  # damaged, and listed
    SuiteWriter(suite, 0).add(case)
    (suite / "suite.json").unlink()  # readable, and not listed
    SuiteWriter(suite, 0).add(case)
    assert load_case(recorded).id == case.id
    assert (recorded / "notes.md").read_bytes() == b"mine"


def test_recording_says_in_one_line_what_is_in_the_way(recorded, tmp_path, capsys):
    log = log_files.write_gpudrive(tmp_path)
    words = ["record", "--log", str(log), "--horizon", "4", "-o", str(tmp_path / "out")]
    assert run(words) == 0
    case = min((tmp_path / "out").glob("*/scenario.json"))
    (tmp_path / "out" / "suite.json").unlink()
    case.write_bytes(THEIRS["scenario.json"])
    capsys.readouterr()
    assert run(words) == 2
    assert capsys.readouterr().err.strip().split("\n")[-1].startswith(f"regents: {case} is of no case")
    assert case.read_bytes() == THEIRS["scenario.json"]
