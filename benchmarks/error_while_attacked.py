"""How far off vehicles are from where `Mirror` foresaw them while an adversary attacks, whose drive it knows.

    regents record -c shipped:crossing --count 10 --seed 452 -o cases/
    python -m benchmarks.error_while_attacked cases/

Windows go on in SUMO's live traffic with `idm` at the wheel, as in `python -m benchmarks live`. At every renewal of
a plan is asked where all others within 60 m of the ego will be; the answer is held against where they are then.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

import numpy as np

from benchmarks.live_windows import LiveWindow, drive_window
from regents_cosim.cases.suite import load_suite
from regents_cosim.live.attacker import Attacker
from regents_cosim.live.host.interface import Frame
from regents_cosim.live.predict.moments import DT_S
from regents_cosim.live.search.plan import Plan
from regents_cosim.live.search.replanner import Replanner
from regents_cosim.mirror.programs.compile_cache import keep_compiled_programs

_NEAR_M = 60.0
_AFTER_S = (1.0, 2.0, 3.0)


@contextmanager
def watched() -> Iterator[dict[float, list[float]]]:
    """How far off others are [m] after so many seconds, in all attacks that are made meanwhile."""
    off: dict[float, list[float]] = defaultdict(list)
    foreseen: dict[int, list[tuple[float, str, np.ndarray]]] = defaultdict(list)  # for which tenth of a second
    renew, step = Replanner.renewed, Attacker.step

    def renewed(self: Replanner, frame: Frame, plan: Plan) -> Plan | None:
        """Note what is foreseen."""
        told = self.forecast(frame, plan, max(_AFTER_S))
        for row, name in enumerate(told.ids):
            there = np.stack([told.tracks.x[row], told.tracks.y[row]], axis=1)
            away = np.hypot(*(there[0] - [frame.x[0], frame.y[0]]))
            for after_s in _AFTER_S if row and name != plan.adversary and away < _NEAR_M else ():
                at = round(after_s / DT_S)
                if told.tracks.valid[row, at]:
                    foreseen[round((frame.time_s + after_s) / DT_S)].append((after_s, name, there[at]))
        return renew(self, frame, plan)

    def stepped(self: Attacker, frame: Frame, wanted: object) -> None:
        """Compare it with what has come."""
        if self.attack is None:
            foreseen.clear()
        for after_s, name, place in foreseen.pop(round(frame.time_s / DT_S), ()):
            if name in frame.number:
                k = frame.number[name]
                off[after_s].append(float(np.hypot(frame.x[k] - place[0], frame.y[k] - place[1])))
        step(self, frame, wanted)  # pyright: ignore[reportArgumentType]

    with patch.object(Replanner, "renewed", renewed), patch.object(Attacker, "step", stepped):
        yield off


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, help="of cases, such as `regents record` makes")
    asked = parser.parse_args()
    keep_compiled_programs()
    print("| cases | after s | n | mean m | nine of ten m |\n|---|---|---|---|---|")
    for folder in asked.folders:
        with watched() as off:
            for seed, case in enumerate(load_suite(folder)):
                drive_window(LiveWindow(case, "idm", "idm", "focused", seed))
        for after_s, found in sorted(off.items()):
            mean, most = np.mean(found), np.percentile(found, 90)
            print(f"| {folder.name} | {after_s:g} | {len(found)} | {mean:.2f} | {most:.2f} |")


if __name__ == "__main__":
    main()
