"""The tables of the command line in the documentation: made from the parser, so that nothing is missing in them."""

import sys

import pytest
from places import ROOT

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
    assert "| 8 | windows wanted |" in rows["`--count`"]
    assert "(focused, regents, king, random, cma-es) |" in rows["`--method`"]
    assert "`CASES`" in rows
    assert not [name for name in rows if "empty" in name or "--quiet" in name]
    assert not [name for name, row in rows.items() if row.endswith("|  |")]  # each says what it does
