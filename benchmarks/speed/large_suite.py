"""A suite of any size: copies of cases under other names, with files of tracks shared; here those of `standard`.

python benchmarks/speed/large_suite.py FOLDER 10000
"""

import os
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.cases.header import HEADER
from regents_cosim.cases.manifest import Suite, SuiteEntry, find_cases, save_suite
from regents_cosim.cases.shipped import suite_folder
from regents_cosim.saving import save_unlisted
from regents_cosim.scenario.scenario import Scenario


def make_large_suite(folder: Path, count: int, loaded: Sequence[Scenario]) -> None:
    """Let `folder`, which is new, hold so many cases, copies of those that are loaded."""
    models = [save_unlisted(case, folder / ".models") for case in loaded]  # as today's version writes them
    shutil.move(folder / ".models" / "maps", folder / "maps")
    entries = []
    for number in range(count):
        model, case = models[number % len(models)], loaded[number % len(models)]
        copy = replace(case, id=f"copy{number:06}-{case.id}")
        digest = content_hash(copy)
        _write(folder / copy.id, model, {case.id: copy.id, content_hash(case): digest})
        entries.append(SuiteEntry(copy.id, digest))
    save_suite(folder, Suite(tuple(entries)))
    shutil.rmtree(folder / ".models")


def _write(folder: Path, model: Path, changed: dict[str, str]) -> None:
    folder.mkdir()
    for path in model.iterdir():
        if path.name != HEADER:
            os.link(path, folder / path.name)
    text = (model / HEADER).read_text()
    for old, new in changed.items():
        text = text.replace(f'"{old}"', f'"{new}"', 1)
    (folder / HEADER).write_text(text)


if __name__ == "__main__":
    standard = [load_case(model) for model in find_cases(suite_folder("standard"))]
    make_large_suite(Path(sys.argv[1]), int(sys.argv[2]), standard)
