"""What a planner says of its decisions: on its way through processes, kept before a crash, and drawn."""

import json
import shlex
import sys
from functools import partial

import msgspec
import numpy as np
import pytest
from params import slow
from scenes import DT, scene

from regents_cosim.errors import DriveError
from regents_cosim.evaluation.drives.crash_verdict import CaseEnd
from regents_cosim.planners.hosting.debug_message import DebugMessage, _say_that_it_is_cut
from regents_cosim.planners.hosting.host_messages import Answer
from regents_cosim.planners.hosting.host_pool import ServedHere
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.planners.interface import MOST_PATHS, MOST_POINTS, Control, Debug, Scene, Snapshot, Waypoints
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.replays.replay import replay_each
from regents_cosim.reports.drawing.camera import centred
from regents_cosim.reports.drawing.palette import SECOND
from regents_cosim.reports.drawing.pictured_case import PicturedCase, draw_ground, draw_moving
from regents_cosim.reports.drawing.texts.legend import legend_rows
from regents_cosim.reports.page.case import PageCase, PageDrive
from regents_cosim.reports.page.map import PageMaps

MADE = scene((0, 0, 10), (30, 0, 0))
AHEAD = np.array([[0.0, 0.0], [5.0, 0.0], [10.0, 1.0]])
THOUGHT = Debug([AHEAD, AHEAD + 1.0], [0.5, 2.0], AHEAD, [AHEAD + 20.0], "keeps on")


class Thinks:
    """Keeps on, and says what it thinks of it, each time of the step."""

    def __init__(self, debug=None):
        self.debug = debug

    def reset(self, scene):
        pass

    def act(self, observation):
        debug = Debug([AHEAD], text=f"step {observation.step}") if self.debug is None else self.debug
        control = Control(0.0, 0.0)
        object.__setattr__(control, "debug", debug)  # unchecked, as in the user's process
        return control


class Points(Thinks):
    def act(self, observation):
        return Waypoints(AHEAD[1:], 0.5, self.debug)


def unchecked(**fields):
    """A `Debug` with what the type does not allow: the user's process does not check types."""
    made = Debug()
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    return made


def asked(host, debug=True):
    host.reset([Scene.of(MADE, 6.0, 0.3)])
    tracks = MADE.tracks
    seen = Snapshot(*(v[:, 0] for v in (tracks.x, tracks.y, tracks.yaw, tracks.speed, tracks.valid)))
    (answer,) = host.act(0, [seen], debug)
    return answer.decision


def same(one, two):
    assert len(one.candidates) == len(two.candidates)
    assert len(one.predictions) == len(two.predictions)
    pairs = [*zip(one.candidates, two.candidates, strict=True), *zip(one.predictions, two.predictions, strict=True)]
    return all(np.array_equal(a, b) for a, b in [*pairs, (one.chosen, two.chosen)]) and (
        tuple(one.costs) == tuple(two.costs) and one.text == two.text
    )


@pytest.mark.parametrize("made", [Thinks, Points])
def test_it_comes_back_as_it_was_given_but_only_where_it_is_asked_for(made):
    host = HostProcess("mine", here=partial(ServedHere, made(THOUGHT)))
    decision = asked(host)
    assert isinstance(decision, Control)
    assert same(decision.debug, THOUGHT)
    assert asked(host, debug=False) == decision, "what was thought is no part of the decision"
    assert asked(host, debug=False).debug is None


@pytest.mark.parametrize(
    ("debug", "said"),
    [
        ("text", "debug is a str, expected a Debug or None"),
        (
            unchecked(candidates=[np.zeros((3, 3))]),
            r"debug.candidates: shape \[3, 3\], expected numbers of shape \[point, 2\]",
        ),
        (unchecked(candidates=[[[1, 2], [3]]]), "debug.candidates: not made of numbers, or with rows of different len"),
        (unchecked(candidates=3), "debug.candidates is a int, expected a list"),
        (unchecked(predictions=["a"]), "debug.predictions: not made of numbers"),
        (unchecked(costs=["a"]), "debug.costs: not made of numbers"),
        (unchecked(text=3), "debug.text is a int, expected a text"),
        (Debug(chosen=np.full((2, 2), np.nan)), "debug.chosen: not finite"),
        (Debug([AHEAD], [1.0, 2.0]), "debug.costs: 2, expected one for each of 1 paths"),
        (Debug([AHEAD], [np.inf]), "debug.costs: not finite"),
    ],
)
def test_what_does_not_fit_is_said(debug, said):
    with pytest.raises(DriveError, match=said):
        asked(HostProcess("mine", here=partial(ServedHere, Thinks(debug))))


def test_what_is_too_long_is_cut_and_said_once(capsys):
    _say_that_it_is_cut.cache_clear()
    long = np.zeros((MOST_POINTS + 1, 2))
    host = HostProcess(
        "mine", here=partial(ServedHere, Thinks(Debug([long] * 99, [1.0] * 99, long, [long], "x" * 301)))
    )
    for _ in range(2):
        debug = asked(host).debug
        assert [len(debug.candidates), len(debug.costs), len(debug.text)] == [MOST_PATHS, MOST_PATHS, 300]
        assert [len(path) for path in (debug.candidates[0], debug.chosen, debug.predictions[0])] == [MOST_POINTS] * 3
    assert capsys.readouterr().err.count("`debug` is cut to 32 paths of each kind, 64 points of a path") == 1


def test_nothing_larger_gets_through_from_a_process_that_was_tampered_with():
    large = Answer(0.1, (0.0, 0.0), debug=DebugMessage(candidates=[[(0.0, 0.0)]] * (MOST_PATHS + 1)))
    with pytest.raises(msgspec.ValidationError, match="length <="):
        msgspec.msgpack.decode(msgspec.msgpack.encode(large), type=Answer)
    assert not DebugMessage(chosen=[(0.0, float("nan"))]).sound
    assert DebugMessage(chosen=[]).sound


def test_a_program_says_it_in_its_answer(tmp_path):
    debug = {"candidates": [AHEAD.tolist()], "costs": [1.5], "text": "on"}
    answer = json.dumps({"accel": 0.5, "curvature": 0.0, "debug": debug})
    script = tmp_path / "program.py"
    script.write_text(
        "import sys\n"
        "for line in sys.stdin:\n"
        f"    print('{{\"ok\": true}}' if '\"reset\"' in line[:9] else {answer!r}, flush=True)\n"
    )
    host = HostProcess("program", None, "exec:" + shlex.join([sys.executable, "-S", str(script)]))
    try:
        decision = asked(host)
    finally:
        host.close()
    assert isinstance(decision, Control)
    assert same(decision.debug, Debug([AHEAD], [1.5], text="on"))


@pytest.fixture(scope="module")
def driven():
    with MirrorController(PlannerUnderTest.of(Thinks(), own_process=False)) as driver:
        return driver.drive(MADE)


def test_it_is_kept_for_the_last_seconds_before_a_crash(driven):
    steps = [step for step, _ in driven.debug]
    ego = driven.tracks.x[0] + 2.3
    contact = int(np.argmax(ego >= 30.0 - 2.3))
    assert steps == list(range(contact - round(2.0 / DT), contact + 1))
    assert [one.text for _, one in driven.debug] == [f"step {step}" for step in steps]


@pytest.mark.parametrize(
    ("where", "own_process"), [("sumo", False), slow("highway", True), slow("sumo", True), slow("highway", False)]
)
def test_simulators_keep_it_too(where, own_process):
    (found,) = replay_each([MADE], where, PlannerUnderTest.of(Thinks(), own_process=own_process))
    assert found.found is not None, found.reason
    last = found.found[1]
    assert [step for step, _ in found.debug] == list(range(last - round(2.0 / DT), last + 1))
    assert found.debug[-1][1].text == f"step {last}"


def test_without_a_crash_nothing_is_kept():
    planner = PlannerUnderTest.of(Thinks(), own_process=False)
    (found,) = replay_each([scene((0, 0, 5), (0, 3.2, 5))], "mirror", planner)
    assert found.debug == ()


def test_films_and_the_page_show_it(driven):
    step, last = driven.debug[-1][0], THOUGHT
    case, debug = MADE, ((step, last),)
    shown = PicturedCase.of(case, debug)
    words = {entry.words for row in legend_rows(shown, 2000) for entry in row}
    assert {"path that the planner weighs", "path that it takes", "path that it expects"} <= words
    view = centred(AHEAD[1], 11.0, (300, 200))

    def purple(at):
        canvas = draw_ground(shown, view, 2)
        draw_moving(shown, canvas, view, at)
        return (np.abs(np.asarray(canvas.finish(), int) - SECOND).max(axis=-1) < 10).sum()

    assert purple(step) > 50
    assert purple(step - 1) == 0
    run = PageDrive("mine", driven.tracks, end=CaseEnd(crashed=True), debug=debug)
    (told,) = PageCase(case, (run,)).content(PageMaps().home(case), None, driven=True)["debug"]
    assert told.keys() == {str(step)}
    assert (told[str(step)]["costs"], told[str(step)]["text"]) == ([0.5, 2.0], "keeps on")
    assert len(told[str(step)]["candidates"]) == 2
