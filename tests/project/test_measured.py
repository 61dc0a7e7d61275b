"""Tables of measured numbers: they are made from `docs/measured.json`, never typed."""

import importlib
import io
import json
import sys

import numpy as np
import pytest
from PIL import Image
from places import ROOT

sys.path.insert(0, str(ROOT / "benchmarks/measured"))


@pytest.fixture(scope="module")
def pages():
    import pages

    return pages


@pytest.mark.parametrize("name", ["README.md", "docs/results.md", "docs/performance.md"])
def test_pages_show_what_was_measured(name, pages):
    text = (ROOT / name).read_text()
    assert "<!-- measured: " in text
    assert pages.filled(text, json.loads(pages.MEASURED.read_text())) == text, (
        "run `python benchmarks/measured/measure.py --pages`"
    )


def test_every_result_is_of_one_commit_and_has_its_command(pages):
    found = json.loads(pages.MEASURED.read_text())
    assert len(found["commit"]) == 12
    assert set(found["results"]) <= set(found["commands"])


def test_a_planner_that_did_not_drive_keeps_its_row(pages, monkeypatch):
    import measure

    other = "commonroad-idm-planner"
    kept = json.loads(pages.MEASURED.read_text())["results"]["planners"]["rows"]
    expected = [row if row["planner"] == other else row | {"crashes": 77} for row in kept]
    monkeypatch.setattr(measure, "commit", lambda: "0" * 12)
    driven = [row for row in expected if row["planner"] != other]
    assert measure.ranked(json.dumps(driven)) == {"commit": "0" * 12, "rows": expected}


def test_a_table_in_the_readme_has_four_rows_and_columns_at_most(pages):
    table = pages.filled("<!-- measured: readme -->\n<!-- end -->", json.loads(pages.MEASURED.read_text()))
    rows = [line for line in table.splitlines() if line.startswith("|")]
    assert len(rows) <= 2 + 4
    assert all(row.count("|") <= 5 for row in rows)


@pytest.mark.parametrize(("script", "figure"), [("draw_how_it_works", "how-it-works.png"), ("draw_rooms", "rooms.png")])
def test_a_drawn_figure_is_what_its_script_draws(script, figure, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    drawn = Image.open(io.BytesIO(importlib.import_module(script).draw()))
    kept = Image.open(ROOT / "docs" / figure)
    assert drawn.size == kept.size
    assert np.abs(np.asarray(drawn, int) - np.asarray(kept, int)).mean() < 0.1
