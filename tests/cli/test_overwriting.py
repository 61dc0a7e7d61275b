"""No command writes over a file that it did not make, and each writes over its own."""

import shutil

import log_files
import pytest
from hostile_places import KINDS, in_time
from table_runs import KINGS

from benchmarks.gallery.make import make_gallery
from regents_cosim.benchmarks.runs import write_table
from regents_cosim.benchmarks.table1 import table1
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import shipped
from regents_cosim.cli import run
from regents_cosim.errors import RegentsError
from regents_cosim.planners.aim_bev.weights_file import SHIPPED, load_weights, save_weights

THEIRS = b'{"schema": 1, "cases": [], "theirs": true}\n'
QUICKSTART = shipped("scenarios") / "quickstart"

# The words of a command, and the files in OUT that it writes.
COMMANDS = {
    "report": (("report", "CASE", "-o", "OUT/page.html"), ("page.html", "page.report.json")),
    "replay": (("replay", "CASE", "--in", "mirror", "--record", "OUT/still.png"), ("still.png",)),
    "moving": (("replay", "CASE", "--in", "mirror", "--record", "OUT/film.gif"), ("film.gif",)),
    "log": (("replay", "CASE", "--in", "mirror", "--log-file", "OUT/log"), ("log",)),
    "inspect": (("inspect", "LOG", "-o", "OUT"), ("PICTURE",)),
    "baseline": (("evaluate", "CASE", "--planner", "log_replay", "--baseline", "OUT/b.json", "--update"), ("b.json",)),
    "markdown": (
        ("evaluate", "CASE", "--planner", "log_replay", "--baseline", "KEPT", "--update", "--markdown", "OUT/s.md"),
        ("s.md",),
    ),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A suite of one crash, its case, a log, and the picture that `inspect` draws of that."""
    folder = tmp_path_factory.mktemp("products")
    suite = shutil.copytree(QUICKSTART, folder / "suite")
    case = next(path for path in find_cases(suite) if (path / "evasion.npz").exists())
    log = log_files.write_table(folder)
    assert run(["inspect", str(log), "-o", str(folder / "drawn")]) == 0
    [picture] = (folder / "drawn").iterdir()
    return {"SUITE": suite, "CASE": case, "LOG": log, "KEPT": folder / "kept.json", "PICTURE": picture.name}


def words(command, place, out):
    found = [str(place.get(word, word)) for word in COMMANDS[command][0]]
    return [word.replace("OUT", str(out)) for word in found]


def written(command, place):
    return [place.get(name, name) for name in COMMANDS[command][1]]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_of_somebody_else_stays(command, place, tmp_path, capsys):
    for name in written(command, place):
        out = tmp_path / name
        out.mkdir()
        (out / name).write_bytes(THEIRS)
        assert run(words(command, place, out)) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert name in said
        assert [(path.name, path.read_bytes()) for path in out.iterdir()] == [(name, THEIRS)]


@pytest.mark.slow
@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "moving"])
def test_its_own_file_is_replaced(command, place, tmp_path):
    for _ in range(2):
        assert run(words(command, place, tmp_path)) == 0
    assert sorted(path.name for path in tmp_path.iterdir() if path.name != ".lock") == written(command, place)


@pytest.mark.parametrize("name", ["suite.html", "scenario.html", "baseline.html"])
def test_a_report_beside_a_suite_or_a_project_leaves_both_as_they_were(name, place, tmp_path):
    suite = shutil.copytree(place["SUITE"], tmp_path / "suite")
    (tmp_path / "my_planner.py").write_text("class P:\n    def reset(self, scene): ...\n    def act(self, o): ...\n")
    before = {path: path.read_bytes() for path in suite.rglob("*") if path.is_file()}
    assert run(["report", str(suite / place["CASE"].name), "-o", str(suite / name)]) == 0
    assert run(["report", str(suite / place["CASE"].name), "-o", str(tmp_path / name)]) == 0
    assert {path: path.read_bytes() for path in before} == before
    assert not (tmp_path / name).with_suffix(".json").exists()
    assert run(["suite", "check", str(suite)]) == 0


def test_what_tables_galleries_and_weights_write_over(tmp_path):
    (tmp_path / "table1.json").write_bytes(THEIRS)
    with pytest.raises(RegentsError, match=r"table1\.json exists"):
        write_table(table1([KINGS]), tmp_path)
    (tmp_path / "README.md").write_bytes(THEIRS)
    with pytest.raises(RegentsError, match=r"README\.md exists"):
        make_gallery(tmp_path)
    assert not (tmp_path / "cases").exists()
    (tmp_path / "w.safetensors").write_bytes(THEIRS)
    with pytest.raises(RegentsError, match="exists and is not"):
        save_weights(load_weights(SHIPPED), tmp_path / "w.safetensors")
    for name in ("README.md", "table1.json", "w.safetensors"):
        assert (tmp_path / name).read_bytes() == THEIRS
    for _ in range(2):
        save_weights(load_weights(SHIPPED), tmp_path / "mine.safetensors")


def test_a_suite_takes_the_place_of_a_suite_alone(place, tmp_path, capsys):
    """Another tool may call a file of its own suite.json."""
    (tmp_path / "suite.json").write_bytes(b'{"tests": [], "schema": 1}')
    for words in (("suite", "merge", "SUITE", "SUITE"), ("suite", "judge", "SUITE")):
        assert run([*(str(place.get(word, word)) for word in words), "-o", str(tmp_path)]) == 2
        assert "is not a suite" in capsys.readouterr().err
    assert (tmp_path / "suite.json").read_bytes() == b'{"tests": [], "schema": 1}'


@pytest.mark.parametrize("kind", ["link to a file", "link to a folder", "link to nothing", "pipe"])
@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "moving"])
def test_what_is_no_file_stays_and_is_not_waited_for(command, kind, place, tmp_path, capsys):
    precious = tmp_path / "precious"
    (precious / "folder").mkdir(parents=True)
    (precious / "file").write_bytes(THEIRS)
    for name in written(command, place):
        out = tmp_path / name
        out.mkdir()
        KINDS[kind](out / name, precious)
        with in_time():
            code = run(words(command, place, out))
        said = capsys.readouterr().err
        if command == "baseline" and kind == "link to nothing":  # there is no baseline yet; the link gives way to it
            assert code == 0
            assert not (out / name).is_symlink()
        else:
            assert (code, said.count("\n")) == (2, 1)
    assert sorted(path.name for path in precious.rglob("*")) == ["file", "folder"]
    assert (precious / "file").read_bytes() == THEIRS
