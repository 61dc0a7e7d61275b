"""What the documentation says is so: commands exist, examples run, every public name is documented."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from places import ROOT
from short_searches import short_commands, short_script

import regents_cosim
from regents_cosim.attacks.methods.presets import METHODS
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.cases.shipped import shipped
from regents_cosim.cases.suite import load_suite
from regents_cosim.cli import run as regents
from regents_cosim.cli.application import app
from regents_cosim.planners.names import OURS
from regents_cosim.saving import SuiteWriter
from regents_cosim.sources.logs.formats import formats

PAGES = sorted((ROOT / "docs").rglob("*.md"))
BIN = Path(sys.executable).parent
HOW_TO = sorted(
    page.stem for page in (ROOT / "docs/how-to").glob("*.md") if page.stem != "aim-bev"
)  # these train for minutes
RUN = ["tutorial", "api", "file-formats", "gallery", *(f"how-to/{name}" for name in HOW_TO)]


class Block(NamedTuple):
    language: str
    text: str


def blocks(page: Path) -> list[Block]:
    return [Block(*found) for found in re.findall(r"^```(\w+)\n(.*?)^```$", page.read_text(), re.DOTALL | re.MULTILINE)]


def commands(page: Path) -> list[str]:
    """Lines of shell blocks, those that a backslash continues as one, without comments."""
    text = "".join(text for language, text in blocks(page) if language == "bash").replace("\\\n", " ")
    return [line for line in (re.sub(r"\s+#.*", "", line).strip() for line in text.splitlines()) if line]


COMMANDS = sorted({c for page in [*PAGES, ROOT / "README.md"] for c in commands(page) if c.startswith("regents ")})


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_are_spelled_as_the_program_wants_them(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for settings in re.findall(r"--config (\S+)", command):
        Path(settings).touch()
    words = shlex.split(command)[1:]
    words = words[: words.index("--")] if "--" in words else words
    app.parse_args(words, exit_on_error=False, print_error=False)


@pytest.mark.parametrize("target", sorted({c for page in [*PAGES, ROOT / "CONTRIBUTING.md"] for c in commands(page)
                                           if c.startswith("make ")}))  # fmt: skip
def test_targets_are_in_the_makefile(target):
    done = subprocess.run(["make", "--dry-run", *target.split()[1:]], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_every_public_name_is_documented():
    text = (ROOT / "docs/api.md").read_text()
    for name in regents_cosim.__all__:
        home = getattr(regents_cosim, name)
        assert re.search(rf"^::: regents_cosim\.\S+\.{name}$|`{name}`", text, re.MULTILINE), (name, home)


LINKED = [*PAGES, *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md"))]


@pytest.mark.parametrize("page", LINKED, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page):
    text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(), flags=re.DOTALL)
    for target in re.findall(r"\]\((?!https?:|mailto:|#)([^)#\s]+)", text):
        assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_guide_for_contributors_names_what_there_is():
    """Its files exist, apart from yours, and hold the names that it says are in them."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    folders = ("benchmarks", "docs", "examples", "regents_cosim", "tests")
    inside = (path for name in folders for path in (ROOT / name).rglob("*") if path.suffix in (".py", ".md", ".js"))
    files = [*ROOT.glob("*.md"), *inside]
    found = {
        name: [path for path in files if f"/{path.relative_to(ROOT)}".endswith(f"/{name}")]
        for name in re.findall(r"`([\w/.-]+\.(?:py|md|js))`", text)
    }
    assert not [name for name, paths in found.items() if not paths and not name.endswith("yours.py")]
    for what, name in re.findall(r"`(\w+)`\s+(?:of|in)\s+`([\w/.-]+\.py)`", text):
        assert any(re.search(rf"\b{what}\b", path.read_text()) for path in found[name]), f"{name} has no {what}"


@pytest.mark.parametrize(
    ("page", "named"),
    [
        ("how-to/planner", [f"`{name}`" for name in OURS]),
        ("method", METHODS),
        ("how-to/logs", [one.what.split()[0] for one in formats().values()]),
    ],
)
def test_what_one_can_choose_is_in_the_documentation(page, named):
    text = (ROOT / f"docs/{page}.md").read_text()
    missing = [name for name in named if name not in text]
    assert not missing, f"docs/{page}.md does not name {', '.join(missing)}: add it where the others of its kind stand"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_pages_say_at_their_top_whom_they_serve(page):
    assert any(line.startswith("*For ") for line in page.read_text().splitlines()[:4])


def test_the_documentation_is_short():
    assert len((ROOT / "README.md").read_text().split()) <= 600
    assert len((ROOT / "docs/results.md").read_text().split()) <= 1_500
    assert len((ROOT / "docs/performance.md").read_text().split()) <= 800
    assert sum(len(page.read_text().split()) for page in PAGES) <= 20_500


# --- examples -------------------------------------------------------------------------------------


def sumo_files(folder: Path) -> None:
    """`your.sumocfg` is the grid's."""
    for name in ("grid.net.xml", "grid.rou.xml"):
        shutil.copy(shipped("sumo_nets") / "grid" / name, folder)
    shutil.copy(shipped("sumo_nets") / "grid/grid.sumocfg", folder / "your.sumocfg")


def a_table(folder: Path) -> None:
    """Two cars on a straight road, with the columns that the page's mapping names."""
    rows = [f"{name},{k / 10},{x + 10.0 * k / 10},0,0" for name, x in (("a", 0), ("b", 30)) for k in range(91)]
    (folder / "tracks.csv").write_text("\n".join(["track,stamp,east,north,heading", *rows]) + "\n")


def a_suite(folder: Path) -> None:
    shutil.copytree(shipped("scenarios") / "quickstart", folder / "suite")


def few_cases(folder: Path) -> None:
    """Of the shipped suite those of one network; its commands are given these instead."""
    suite = SuiteWriter(folder / "few", 0)
    for case in load_suite(shipped("scenarios") / "quickstart"):
        if case.id.startswith("crossing-"):
            suite.add(case)


def a_header(folder: Path) -> None:
    shutil.copy(ROOT / "examples/regents_planner.hpp", folder)


BEFORE = {
    "how-to/ci": few_cases,
    "how-to/planner": a_header,
    "how-to/sumo": sumo_files,
    "how-to/live": sumo_files,
    "how-to/logs": a_table,
    "file-formats": a_suite,
}


FOR_THE_SHELL = re.compile(r"[][*?$|&;<>`]")  # what bash would make something else of


def shell(text: str, folder: Path) -> None:
    environment = os.environ | {"PATH": f"{BIN}:{os.environ['PATH']}"}
    done = subprocess.run(["bash", "-euc", text], cwd=folder, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}"


def run_lines(text: str, folder: Path) -> None:
    """Plain commands of ours run in this process, which keeps what it has compiled; all else is the shell's."""
    if "<<" in text:
        return shell(text, folder)
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] == ["regents"] and not FOR_THE_SHELL.search(line):
            assert regents(words[1:]) == 0, line
        elif words:
            shell(line, folder)


def file_of(block: Block) -> str | None:
    """Where a block belongs that begins with a comment that is a file's name."""
    named = re.match(r"(?:#|//) (\w+\.(?:py|cpp))\b", block.text)
    return named[1] if named else "tracks.toml" if block.language == "toml" else None


def run_page(page: Path, folder: Path) -> None:
    """First the files of a page are written, then all else runs in one folder, one after the other."""
    for block in blocks(page):
        if name := file_of(block):
            (folder / name).write_text(block.text)
    for block in blocks(page):
        text = block.text
        if "CASE" in text:
            text = text.replace("CASE", load_manifest(folder / "suite").cases[0].case)
        if block.language == "bash":
            text = text.replace("shipped:quickstart", "few") if (folder / "few").is_dir() else text
            run_lines(short_commands(text), folder)
        elif block.language == "python" and not file_of(block):
            (folder / "example.py").write_text(short_script(text, windows=1))
            shell("python example.py", folder)


@pytest.mark.slow
@pytest.mark.parametrize("name", RUN)
def test_examples_of_a_page_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    BEFORE.get(name, lambda folder: None)(tmp_path)
    run_page(ROOT / f"docs/{name}.md", tmp_path)
