"""What a caller's own Python gives: an unknown word and a value of a wrong kind get one clear error.

The calls run in a process of their own, as the test session checks all types itself.
"""

import subprocess
import sys

import pytest
from places import ROOT

QUICKSTART = ROOT / "scenarios" / "quickstart"
REFUSED = {
    'replay(cases[0], "carla")': "`where` 'carla', expected one of sumo, highway, mirror",
    'replay(cases[0], "highway", mode="action")': "`mode` 'action', did you mean actions",
    'replay(cases[0], background="none")': "`background` 'none', expected one of log, reactive",
    'evaluate(cases[0], "idm", where="mirrors")': "`where` 'mirrors', did you mean mirror",
    'list(attack(cases[0].before_attack(), engine="gpu"))': "`engine` 'gpu', expected one of auto",
    'export(cases[0], "xml", "new")': "`to` 'xml', expected one of fcd",
    'TrainConfig(teacher="me")': "`teacher` 'me', expected one of log",
    "judge(cases)": "expected a Scenario (judge takes one case)",
    'save_case(cases, "new")': "expected a Scenario (save_case takes one case)",
    'export(cases, "csv", "new")': "expected a Scenario (export takes one case)",
    "replay(cases)": "expected a path",
    'list(attack("suite"))': "attack() takes scenarios, found the path suite (read them with load_suite)",
    'evaluate([], "idm")': "no cases to drive in",
    "record(None)": "`source` is a NoneType, None, expected a path",
    'SumoInput("a.sumocfg", begin_s="5")': "`begin` is '5', expected a number",
    'LogInput("a.csv", ego=3)': "`ego` is 3, expected a text",
    'export(cases[0], "csv", ".")': ". is the current folder",
}
ACCEPTED = [
    'LogInput("a.csv", map="b.osm", columns="c.toml") == '
    'LogInput(Path("a.csv"), map=Path("b.osm"), columns=Path("c.toml"))',
    'SumoInput("a.sumocfg", "b.net.xml", "c.rou.xml", ["d.add.xml"]) == '
    'SumoInput(Path("a.sumocfg"), Path("b.net.xml"), (Path("c.rou.xml"),), (Path("d.add.xml"),))',
    'Recipe(nets="merge", planners="idm") == Recipe(nets=("merge",), planners=("idm",))',
    'report(cases[:1], "page.html", planners="idm") is None and Path("page.html").exists()',
]
SAYS = """
import sys
from pathlib import Path
from regents_cosim import *
cases = load_suite(sys.argv[1])
for call in sys.argv[2:]:
    try:
        print(eval(call))
    except RegentsError as error:
        print(error)
"""


def said_to(calls, folder):
    """What each call returns or raises, with `folder` as the current one."""
    done = subprocess.run(
        [sys.executable, "-c", SAYS, str(QUICKSTART), *calls], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.slow
def test_unknown_words_and_values_of_a_wrong_kind_are_refused(tmp_path):
    said = said_to(REFUSED, tmp_path)
    assert [line for line, expected in zip(said, REFUSED.values(), strict=True) if expected not in line] == []
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_texts_are_paths_and_one_thing_stands_for_several(tmp_path):
    assert said_to(ACCEPTED, tmp_path) == ["True"] * len(ACCEPTED)
