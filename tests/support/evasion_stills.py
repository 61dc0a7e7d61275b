"""Draws the stills of some attacked cases of a suite, chosen by seed and judged again: does one believe the evasions?

python tests/support/evasion_stills.py scenarios/standard 20 0 FOLDER
"""

import sys
from pathlib import Path

import numpy as np

from regents_cosim.cases.suite import load_suite
from regents_cosim.reports.drawing.pictured_case import PicturedCase
from regents_cosim.reports.drawing.texts.caption import story
from regents_cosim.reports.picture import draw_still
from regents_cosim.verdicts.judge import judge_each

if __name__ == "__main__":
    suite, count, seed, target = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])
    crashes = [case for case in load_suite(Path(suite)) if case.judgement is not None]
    chosen = np.random.default_rng(seed).permutation(len(crashes))[:count]
    target.mkdir(parents=True, exist_ok=True)
    for number, judged in enumerate(judge_each([crashes[index] for index in sorted(chosen.tolist())])):
        draw_still(judged, target / f"{number:02d}.png")
        if judged.judgement is not None:
            print(f"{number:02d} {judged.id}: {story(PicturedCase.of(judged))}")
