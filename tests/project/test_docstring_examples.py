"""Examples in docstrings are run as they stand there."""

import ast
import re
import shutil
import textwrap
import tomllib

import pytest
from places import ROOT
from scenes import scene

from regents_cosim.cases.shipped import shipped
from regents_cosim.evaluation.drives.driving import drive_each


def docstrings(containing=""):
    """Name of the place and text of every docstring in files with the text `containing`."""
    for file in sorted((ROOT / "regents_cosim").rglob("*.py")):
        code = file.read_text()
        for node in ast.walk(ast.parse(code)) if containing in code else ():
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                name = f"{file.relative_to(ROOT)}:{getattr(node, 'name', '')}".rstrip(":")
                yield name, ast.get_docstring(node) or ""


def examples(language):
    return [
        pytest.param(code, id=name)
        for name, text in docstrings(containing="```")
        for code in re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    ]


@pytest.mark.filterwarnings("default")  # libsumo 1.24 warns as it is imported, and crashes where that is an error
@pytest.mark.parametrize("code", examples("python"))
def test_python_examples_run_and_their_planners_drive(code, tmp_path, monkeypatch):
    shutil.copytree(shipped("scenarios") / "quickstart", tmp_path / "suite")
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "example", "exec"), (names := {"__name__": "example"}))
    (tmp_path / "example.py").write_text(code)
    for name in [name for name, value in names.items() if getattr(value, "__module__", "") == "example"]:
        (drive,) = drive_each([scene((0, 0, 10), (30, 0, 4))], f"example.py:{name}")
        assert (drive.error, drive.hits) == ("", None)


@pytest.mark.parametrize("text", examples("toml"))
def test_toml_examples_can_be_read(text):
    assert tomllib.loads(text)


def test_every_python_example_is_marked_as_one():
    """What is only indented, or not even that, is not run: `class`, `def` and `import` stand in marked blocks alone."""
    for name, text in docstrings():
        rest = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
        code = re.search(r"^\s*(>>> |class \w+[:(]|def \w+\(|from [\w.]+ import |import [\w.]+$)", rest, re.MULTILINE)
        assert code is None, f"{name}: {textwrap.shorten(rest[code.start() :], 80)}"
