"""Planners that do what no planner should, to the process that hosts them and to what they answer through."""

import gc
import os
import pickle
import shutil
import struct
import subprocess
import sys
import tempfile
import time

import numpy as np

from regents_cosim import Control
from regents_cosim.planners.hosting.host_messages import Answer, Decided, encoder
from regents_cosim.planners.hosting.message_socket import MessageSocket
from regents_cosim.planners.interface import Placement

_DESCRIPTORS = range(3, 4096)


class Bomb:
    """Unpickling it leaves a file."""

    def __reduce__(self):
        return (open, (os.environ["REGENTS_BOMB"], "w"))


class Good:
    def reset(self, scene):
        self.scene = scene

    def act(self, observation):
        return Control(1.0, 0.0)


class Misbehaves(Good):
    """At step 1."""

    def act(self, observation):
        return self.misbehave() or Control(1.0, 0.0) if observation.step == 1 else Control(1.0, 0.0)


def everywhere(content):
    for descriptor in _DESCRIPTORS:
        try:
            os.set_blocking(descriptor, False)
            os.write(descriptor, content)
        except OSError:
            continue


def talk():
    return next(one for one in gc.get_objects() if isinstance(one, MessageSocket))


class FarAway(Misbehaves):
    def misbehave(self):
        return Placement(1e6, 0.0, 0.0, 1.0)


class TooFast(Misbehaves):
    def misbehave(self):
        return Placement(0.0, 0.0, 0.0, 1e308)


class StrayByte(Misbehaves):
    def misbehave(self):
        everywhere(b"x")


class StrayAndDeaf(Misbehaves):
    def misbehave(self):
        everywhere(b"\xa7rc1\x00\x00")
        time.sleep(1000)


class Pickles(Misbehaves):
    def misbehave(self):
        content = pickle.dumps(Bomb())
        everywhere(struct.pack("!i", len(content)) + content)


class PicklesInFrame(Misbehaves):
    def misbehave(self):
        talk().send(pickle.dumps(Bomb()))


class TooLong(Misbehaves):
    def misbehave(self):
        everywhere(b"\xa7rc1\xff\xff\xff\xff")


class AnswersAnother(Misbehaves):
    def misbehave(self):
        talk().send(encoder.encode(Decided(99, [Answer(0.0, (1.0, 0.0))])))


class AnswersTwice(Misbehaves):
    def misbehave(self):
        talk().send(encoder.encode(Decided(4, [Answer(0.0, (1.0, 0.0))])))


class AnswersNaN(Misbehaves):
    def misbehave(self):
        talk().send(encoder.encode(Decided(4, [Answer(0.0, (float("nan"), 0.0))])))


class AnswersTooMuch(Misbehaves):
    def misbehave(self):
        talk().send(encoder.encode(Decided(4, [Answer(0.0, (100.0, 0.0))])))


class AnswersFarAway(Misbehaves):
    def misbehave(self):
        talk().send(encoder.encode(Decided(4, [Answer(0.0, placement=(1e6, 0.0, 0.0, 1.0))])))


class AnswersForTwo(Misbehaves):
    def misbehave(self):
        talk().send(encoder.encode(Decided(4, [Answer(0.0, (1.0, 0.0))] * 2)))


class ClosesAll(Misbehaves):
    def misbehave(self):
        os.closerange(3, 4096)


class Forks(Misbehaves):
    def misbehave(self):
        os.fork()


class Shouts(Misbehaves):
    def misbehave(self):
        raise ValueError("a" * 50_000_000)


class Unspeakable(Misbehaves):
    def misbehave(self):
        class SpeechlessError(Exception):
            def __str__(self):
                raise RuntimeError("no words")

        raise SpeechlessError


class Surrogates(Misbehaves):
    def misbehave(self):
        raise ValueError("half \ud800 a character")


class NoTemporaryFolder(Misbehaves):
    def misbehave(self):
        shutil.rmtree(tempfile.gettempdir())
        raise OSError("gone")


class Infinite(Misbehaves):
    def misbehave(self):
        return Control(float("inf"), np.float32(0.0))


class HasChildren(Good):
    """Starts children, and writes their ids to a file."""

    def reset(self, scene):
        sleep = [sys.executable, "-S", "-c", "import time; time.sleep(1000)"]
        child = subprocess.Popen(sleep)
        with open(os.environ["REGENTS_CHILDREN"], "a") as file:
            file.write(f"{os.getpid()} {child.pid}\n")


class DeafInReset(Good):
    def reset(self, scene):
        if scene.id.startswith("deaf"):
            time.sleep(1000)


class NeverMade(Good):
    def __init__(self):
        time.sleep(1000)
