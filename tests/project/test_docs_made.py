"""What programs make of the documentation: the tables of the command line, and the pictures of the gallery."""

import json
import sys

import pytest
from places import ROOT

from regents_cosim.cases.files import load_header

sys.path.insert(0, str(ROOT / "docs"))
pytest.importorskip("mkdocs", reason="needs what `make docs` does")


@pytest.fixture(scope="module")
def page() -> str:
    import command_tables

    text = (ROOT / "docs/command-line.md").read_text()
    assert command_tables.MARKER in text
    return command_tables.on_page_markdown(text, None, None, None)


def test_every_command_has_its_table(page):
    for command in ("regents attack", "regents suite coverage", "regents train aim-bev", "regents bench table1"):
        assert f"\n### {command}\n" in page


def test_an_option_stands_with_its_default_its_choices_and_its_words(page):
    attack = page.split("\n### regents attack\n")[1].split("\n### ")[0]
    rows = {line.split(" | ")[0].strip("| "): line for line in attack.splitlines() if line.startswith("| `")}
    assert "| 8 | number of windows |" in rows["`--count`"]
    assert "| conflicts |" in rows["`prefer`"]
    assert rows["`prefer`"].endswith("(conflicts, pedestrians, none) |")
    assert "`CASES`" in rows
    assert not [name for name in rows if "empty" in name or "--quiet" in name]
    assert not [name for name, row in rows.items() if row.endswith("|  |")]  # each says what it does


def test_the_gallery_shows_ten_telling_crashes_in_small_pictures():
    import make_gallery

    shown = make_gallery.shown()
    parts = (ROOT / "docs/gallery.md").read_text().split("\n## ")[1:]
    for (_, case), part in zip(shown, parts, strict=False):
        judgement = load_header(case).judgement
        assert judgement.telling
        assert judgement.flawless == ("Flawless." in part)
    assert len({picture for picture, _ in shown}) == 10
    for picture, case in shown:
        assert 5_000 < picture.stat().st_size < 60_000
        assert json.loads((case / "scenario.json").read_text())["attack"]["outcome"] == "collision"
