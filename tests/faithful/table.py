"""How faithful recordings are, as the table of docs/results.md: `python tests/faithful/table.py --write`.

It records windows of every place, holds them against SUMO's own log of the same run (a centimetre, a tenth of a degree,
lights letter by letter), and CommonRoad's files against commonroad-io. Exit code 1 where anything differs.
"""

import argparse
import re
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "support"), str(HERE)]

import against_sumo  # noqa: E402
import test_commonroad as commonroad  # noqa: E402
from places import ROOT  # noqa: E402

from regents_cosim.errors import LogError, NoWindowError  # noqa: E402
from regents_cosim.scenario.scenario import LeftOut  # noqa: E402
from regents_cosim.sources.left_out import sentence_of  # noqa: E402
from regents_cosim.sources.logs.record import scenes_of  # noqa: E402

PAGE = ROOT / "docs" / "results.md"
BEGIN, END = "<!-- made by tests/faithful/table.py -->", "<!-- end of it -->"


@dataclass
class Row:
    """What came of a kind of places."""

    kind: str
    places: int = 0
    without: int = 0  # places without a window, or not on this machine
    states: int = 0
    lights: int = 0
    differing: list[str] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)

    def leave_out(self, every: Iterable[LeftOut]) -> None:
        """Count those of a ledger, but for who is too far away."""
        for one in every:
            if one.reason != "radius":
                words = sentence_of(LeftOut(one.reason, 2, (), "" if one.reason == "limit" else one.detail))
                self.left_out[words.removeprefix("2 road users ")] += one.count

    def __str__(self) -> str:
        left = "; ".join(f"{count} {words}" for words, count in self.left_out.items()) or "none"
        places = f"{self.places} (and {self.without} without traffic)" if self.without else str(self.places)
        return f"| {self.kind} | {places} | {self.states:,} | {self.lights:,} | {len(self.differing)} | {left} |"


def of_sumo(kind: str, only: str) -> Row:
    """A kind of places that SUMO drives."""
    row, (names, place) = Row(kind), against_sumo.PLACES[kind]
    for name in (one for one in names if only in one):
        with tempfile.TemporaryDirectory() as folder:
            try:
                cases, compared, log = place(name, Path(folder))
            except (NoWindowError, against_sumo.NoPlaceError) as why:
                print(f"{name}: {why}", file=sys.stderr)
                row.without += 1
                continue
            row.places += 1
            row.states += sum(one.compared for one in compared)
            row.differing += [f"{name}: {line}" for line in against_sumo.differing((cases, compared, log))]
            try:
                row.lights += against_sumo.assert_same_lights(cases, log)
            except AssertionError as why:
                row.differing.append(f"{name}: lights, {why}")
            for case in cases:
                row.leave_out(case.provenance.left_out)
            print(f"{name}: {row.states} states so far, {len(row.differing)} differ", file=sys.stderr)
    return row


def of_commonroad(files: Iterable[Path]) -> Row:
    """Files of CommonRoad, by both readers."""
    row = Row("files of CommonRoad, against commonroad-io")
    for file in files:
        try:
            ((_, _, scene),) = scenes_of(file)
        except LogError:  # maps alone
            row.without += 1
            continue
        row.places += 1
        row.leave_out(scene.left_out)
        try:
            row.states += commonroad.compare(file)
        except AssertionError as why:
            row.differing.append(f"{file.name}: {str(why).partition(chr(10))[0] or 'another place or size'}")
    return row


def table(rows: Iterable[Row]) -> Iterator[str]:
    """As Markdown."""
    yield "| places | how many | states compared | lights compared | differing | left out of the cases, and said |"
    yield "|---|---|---|---|---|---|"
    yield from map(str, rows)


def main() -> int:
    """Print the table, or write it into the documentation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="into docs/results.md")
    parser.add_argument("--only", default="", help="places whose names hold this")
    parser.add_argument("--commonroad", type=Path, action="append", default=[], help="more folders of files")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = [of_sumo(kind, asked.only) for kind in against_sumo.PLACES]
    folders = [commonroad.INPUTS, commonroad.DATA, *asked.commonroad]
    known = {file.name: file for folder in folders for file in sorted(folder.rglob("*.xml")) if _is_commonroad(file)}
    rows.append(of_commonroad(file for name, file in known.items() if asked.only in name))
    text = "\n".join(table(rows))
    for line in (line for row in rows for line in row.differing):
        print(line, file=sys.stderr)
    if asked.write:
        page = PAGE.read_text(encoding="utf-8")
        made = f"{BEGIN}\n{text}\n{END}"
        PAGE.write_text(re.sub(f"{BEGIN}.*{END}", lambda _: made, page, flags=re.DOTALL), encoding="utf-8")
    print(text)
    return 1 if any(row.differing for row in rows) else 0


def _is_commonroad(file: Path) -> bool:
    return b"<commonRoad" in file.read_bytes()[:2000]


if __name__ == "__main__":
    sys.exit(main())
