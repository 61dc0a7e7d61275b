"""Tags against labels that were given by looking at pictures of the crashes, without the tags in sight.

`labelled.zip`: crashes on the shipped networks and on the made places of the docs, the last six seconds of those that
are near, and `labels.json`. Those `with_a_say` were looked at while the definitions were made, the others were not.
"""

import json
import zipfile
from pathlib import Path

import pytest

from regents_cosim.cases.files import load_case
from regents_cosim.tags.table import tags_of

LABELS = {
    "cut_in", "cut_out", "hard_brake", "lane_drift", "merge_squeeze", "crossing_path", "turn_across_path",
    "turn_into_path", "wrong_way",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("begins", "at_least"), [("with_a_say", 0.95), ("without_a_say", 0.9)])
def test_what_tags_say_is_what_pictures_show(tmp_path, begins, at_least):
    with zipfile.ZipFile(Path(__file__).with_name("labelled.zip")) as packed:
        packed.extractall(tmp_path)
    labels = json.loads((tmp_path / "labels.json").read_text())
    right = wrong = 0
    for name, said in labels.items():
        if name.startswith(begins):
            given = LABELS & set(tags_of(load_case(tmp_path / name)))
            right += len(given & set(said["yes"]))
            wrong += len(given - set(said["yes"]) - set(said["unsure"]))
    assert right >= 40
    assert right / (right + wrong) >= at_least
