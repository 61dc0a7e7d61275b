"""The programs that `make bench` and `make bench-gpu` run, on what is small."""

import subprocess
import sys

import pytest
from places import ROOT

HERE = ROOT / "benchmarks/speed"


def said(*words: str) -> str:
    return subprocess.run([sys.executable, *map(str, words)], capture_output=True, text=True, check=True).stdout


def cells(text: str) -> list[list[str]]:
    """Of a table, without its head."""
    rows = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in row] for row in rows[2:]]


@pytest.mark.slow
def test_the_table_of_costs_has_times_ratios_and_memory():
    (row,) = cells(said(HERE / "table.py", "--rows", "at once", "--at-once", "2"))
    assert row[:2] == ["2 scenarios at once", "run"]
    assert all(float(cell) > 0 for cell in row[2:])
    assert len(row) == 8


@pytest.mark.slow
def test_the_table_of_a_device_is_printed_and_written(tmp_path):
    written = tmp_path / "new" / "table.md"
    printed = said(HERE / "accelerator.py", "--sizes", "2", "--iterations", "2", "-o", written)
    assert written.read_text().splitlines() == printed.splitlines()[:-1]
    rows = cells(printed)
    assert [row[:2] for row in rows] == [["king", "2"], ["focused", "2"]]
    assert all(float(row[2]) > 0 for row in rows)
