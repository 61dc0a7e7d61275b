"""Mutated files for every reader of the package: `python -m benchmarks.endurance.fuzz --count 100000 --seed 1`.

One line of JSON per reader: how many inputs, how many it accepted and refused, how fast, the slowest, the biggest
growth of memory, and every failure. An input is made from seed, reader and number alone, so it can be made again.

The readers run in a child process that is watched: a hang, a segmentation fault or an end by the system is a failure
of the input at hand, and the next child goes on behind it.
"""

import argparse
import faulthandler
import json
import multiprocessing
import os
import random
import re
import resource
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache, partial
from multiprocessing.connection import Connection
from pathlib import Path

from benchmarks.endurance.readers import Reader, readers
from regents_cosim.errors import RegentsError
from regents_cosim.plain_text import printable
from tests.support.peak_memory import peak_bytes

LONGEST_S = 2.0  # of processor time for one input,
LONGEST_S_PER_MB = 1.0  # and this much more for a megabyte of it
_TRIES = 3  # of an input that takes longer, the fastest counts: a busy machine slows down some, a slow reader all
TOO_SLOW = f"more than {LONGEST_S:g} s"
_HANG_S = 60.0  # of the clock, and ten times what its processor time may be, after which the child is ended
MOST_BYTES = 500_000_000  # that memory may grow by with one input
_LIMIT_BYTES = 3_000_000_000  # that the child gets at most
LONGEST_MESSAGE = 500
_LARGEST = 1 << 19  # bytes of a mutated file
_MUTATIONS_FROM = 32  # no reader has as many seeds and hostile files
_MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None


@dataclass
class Tally:
    """The results of one reader."""

    reader: str
    inputs: int = 0
    accepted: int = 0
    refused: int = 0
    seconds: float = 0.0  # of the clock
    slowest_s: float = 0.0  # of processor time
    growth_mb: float = 0.0  # most that memory grew by with one input
    failures: dict[str, int] = field(default_factory=dict)  # what happened, how often
    kept: dict[str, str] = field(default_factory=dict)  # the first input of each: its number, or a file

    @property
    def clean(self) -> bool:
        """Whether the reader kept its promise."""
        return not self.failures

    def fail(self, what: str, where: str) -> None:
        """Count a failure and remember its first input."""
        self.failures[what] = self.failures.get(what, 0) + 1
        self.kept.setdefault(what, where)

    def count(self, verdict: str, failures: Sequence[str], took_s: float, grown: int, where: str) -> None:
        """Count one more input, which `where` names."""
        self.inputs += 1
        self.accepted += verdict == "accepted"
        self.refused += verdict == "refused"
        self.slowest_s = max(self.slowest_s, round(took_s, 3))
        self.growth_mb = max(self.growth_mb, round(grown / 1e6, 1))
        for what in failures:
            self.fail(what, where)

    def add(self, other: "Tally") -> None:
        """Take over what another child counted."""
        for name in ("inputs", "accepted", "refused"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.seconds += other.seconds
        self.slowest_s = max(self.slowest_s, other.slowest_s)
        self.growth_mb = max(self.growth_mb, other.growth_mb)
        for what, times in other.failures.items():
            self.failures[what] = self.failures.get(what, 0) + times
            self.kept.setdefault(what, other.kept[what])


# --- inputs ---------------------------------------------------------------------------------------

_NUMBERS = (
    b"nan", b"inf", b"-inf", b"-1", b"0", b"-0.0", b"1e308", b"-1e308", b"1e9", b"1e-320", b"9" * 25, b"", b"0x10",
    b"0.0000001", b"-99999999", b"2147483648", b"1_0", b"1e", b"--1", "\u0663".encode(), b"true", b"null", b'"1"',
    b"[]",
)  # fmt: skip
_PIECES = (
    *_NUMBERS, b"\xff" * 4, b"\0" * 8, b"\x7f\xff\xff\xff", b"[", b"{", b"}", b"]", b'"', b"'", b"<", b">", b"/>",
    b",", b";", b"\n", b"\r", b"\t", b"\x1b[31m", "\u202e".encode(), b"\xed\xa0\x80", b"\xef\xbb\xbf", b"<!--", b"]]>",
    b"<a/>", b"&amp;", b"&a;", b"&#0;", b"\x1f\x8b", b"../", b"%n", b"\\u0000", b"\\ud800", b".", b"(", b"t", b"R",
    b"\x85", b"K\x01",
)  # fmt: skip
_BOMBS = (
    b"[",
    b"{",
    b'{"a":',
    b"<a>",
    b"(",
    b"((",
    b")\x85",
    b"<a/>",
    b'"',
    b"\0",
    b"1,",
    b"\n",
    b"A",
    b"&lt;",
    b"\x0a\x80",
)
_WHOLES = (0, 1, -1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 2**53, 2**63 - 1, 2**64 - 1)
_DIGITS = re.compile(rb"-?\d+\.?\d*(?:e-?\d+)?")
_WORDS = re.compile(rb"[A-Za-z_][A-Za-z_0-9]{2,}")


def mutated(seeds: Sequence[bytes], rng: random.Random) -> bytes:
    """Change one of `seeds` up to eight times; the result has at most 512 KiB."""
    data = bytearray(rng.choice(seeds))
    for _ in range(rng.choice((1, 1, 1, 2, 2, 4, 8))):
        rng.choice(_MUTATIONS)(data, seeds, rng)
    return bytes(data[:_LARGEST])


def _place(data: bytearray, rng: random.Random) -> int:
    return rng.randrange(len(data) + 1)


def _flip(data: bytearray, seeds: Sequence[bytes], rng: random.Random) -> None:
    if data:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _set(data: bytearray, seeds: Sequence[bytes], rng: random.Random) -> None:
    if data:
        data[rng.randrange(len(data))] = rng.randrange(256)


def _cut(data: bytearray, seeds: Sequence[bytes], rng: random.Random) -> None:
    at = _place(data, rng)
    del data[at : at + rng.choice((1, 1, 4, 16, 64, 1024))]


def _end(data: bytearray, seeds: Sequence[bytes], rng: random.Random) -> None:
    del data[_place(data, rng) :]


def _insert(data: bytearray, seeds: Sequence[bytes], rng: random.Random) -> None:
    at = _place(data, rng)
    data[at:at] = rng.choice(_PIECES)


def _overwrite(data: bytearray, seeds: Sequence[bytes], rng: random.Random) -> None:
    at, piece = _place(data, rng), rng.choice(_PIECES)
    data[at : at + len(piece)] = piece


def _whole(data: bytearray, seeds: Sequence[bytes], rng: random.Random) -> None:
    at, size = _place(data, rng), rng.choice((1, 2, 4, 8))
    value = rng.choice(_WHOLES) % (1 << (8 * size))
    data[at : at + size] = value.to_bytes(size, rng.choice(("little", "big")))


def _number(data: bytearray, seeds: Sequence[bytes], rng: random.Random) -> None:
    _replace_one(data, _DIGITS, rng.choice(_NUMBERS), rng)


def _word(data: bytearray, seeds: Sequence[bytes], rng: random.Random) -> None:
    words = _WORDS.findall(rng.choice(seeds)[:20_000])
    if words:
        _replace_one(data, _WORDS, rng.choice(words), rng)


def _replace_one(data: bytearray, pattern: re.Pattern[bytes], by: bytes, rng: random.Random) -> None:
    at = _place(data, rng)
    found = pattern.search(data, at, at + 400)
    if found:
        data[found.start() : found.end()] = by


def _repeat(data: bytearray, seeds: Sequence[bytes], rng: random.Random) -> None:
    at = _place(data, rng)
    piece = data[at : at + rng.choice((1, 8, 64, 400))]
    data[at:at] = piece * rng.choice((1, 1, 2, 10, 100))


def _splice(data: bytearray, seeds: Sequence[bytes], rng: random.Random) -> None:
    other = rng.choice(seeds)
    start, at = rng.randrange(len(other) + 1), _place(data, rng)
    piece = other[start : start + rng.choice((8, 64, 1024))]
    data[at : at + rng.choice((0, len(piece)))] = piece


def _line(data: bytearray, seeds: Sequence[bytes], rng: random.Random) -> None:
    lines = bytes(data).split(b"\n")
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[at : at + rng.choice((0, 1))] = [lines[to]]
    data[:] = b"\n".join(lines)


def _bomb(data: bytearray, seeds: Sequence[bytes], rng: random.Random) -> None:
    if rng.random() < 0.1:
        at = _place(data, rng)
        data[at:at] = rng.choice(_BOMBS) * rng.choice((100, 1000, 20_000))


_MUTATIONS: tuple[Callable[[bytearray, Sequence[bytes], random.Random], None], ...] = (
    _flip, _set, _cut, _end, _insert, _insert, _overwrite, _whole, _number, _number, _number, _word, _repeat, _splice,
    _line, _bomb,
)  # fmt: skip


@lru_cache(maxsize=1)
def _hostile(name: str, made: Callable[[], tuple[bytes, ...]]) -> tuple[bytes, ...]:
    """Large files, made once for all inputs of a reader."""
    return made()


def input_of(reader: Reader, seed: int, number: int) -> bytes:
    """The input of that number: the seeds, then hostile files, then mutations."""
    if number < len(reader.seeds):
        return reader.wrap(reader.seeds[number])
    if number < _MUTATIONS_FROM:
        hostile = _hostile(reader.name, reader.hostile)
        if number < len(reader.seeds) + len(hostile):
            return hostile[number - len(reader.seeds)]
    rng = random.Random(f"{seed} {reader.name} {number}")
    return reader.wrap(mutated(reader.seeds, rng))


# --- the child ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Task:
    reader: str
    first: int
    count: int
    seed: int


def place(reader: Reader, folder: Path) -> Path:
    """Lay out the files that a reader needs; where its input goes."""
    for name, content in reader.beside.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder / reader.file


def try_one(reader: Reader, path: Path, data: bytes) -> tuple[str, str]:
    """`accepted`, `refused`, or `failed` and how."""
    path.write_bytes(data)
    try:
        reader.read(path)
    except RegentsError as error:
        said = str(error)
        if len(said) > LONGEST_MESSAGE:
            return "failed", f"a message of more than {LONGEST_MESSAGE} characters: {type(error).__name__}"
        if printable(said, limit=None) != said:
            return "failed", f"a message that is no line of printable text: {_where(error)}"
        return "refused", ""
    except BaseException as error:  # also what C++ and Rust throw
        return "failed", f"{type(error).__name__} at {_where(error)}"
    return "accepted", ""


def _where(error: BaseException) -> str:
    """The last line of ours, and the last of all."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "regents_cosim" in frame.filename] or frames
    last, end = ours[-1], frames[-1]
    inner = "" if end is last else f" in {Path(end.filename).name}:{end.lineno}"
    return f"{Path(last.filename).name}:{last.lineno}{inner}"


def _work(tasks: list[_Task], pipe: Connection, at: "multiprocessing.sharedctypes.SynchronizedArray") -> None:
    """Run tasks; `at` says which input is read, and until when it may be."""
    log = open(os.environ["FUZZ_LOG"], "w")  # noqa: SIM115 as long as the process
    faulthandler.enable(log)
    warnings.simplefilter("error", RuntimeWarning)
    warnings.filterwarnings("ignore", category=UserWarning)
    _bound_memory()
    known = readers()
    for number, task in enumerate(tasks):
        with tempfile.TemporaryDirectory(dir=_MEMORY) as folder:
            pipe.send(_run(known[task.reader], task, number, Path(folder), at))
    pipe.send(None)


def _bound_memory() -> None:
    if sys.platform == "linux":
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(resource.RLIMIT_AS, (used + _LIMIT_BYTES, hard))


def _run(reader: Reader, task: _Task, number: int, folder: Path, at: Sequence[float]) -> Tally:
    tally, path = Tally(reader.name), place(reader, folder)
    start = time.monotonic()
    most = peak_bytes()
    for index in range(task.first, task.first + task.count):
        data = input_of(reader, task.seed, index)
        at[0], at[1], at[2] = number, index, time.monotonic() + _HANG_S + 10.0 * _TRIES * longest_s(len(data))
        verdict, how, took = _timed(reader, path, data)
        grown = max(peak_bytes() - most, 0)
        most += grown
        failures = [how] if verdict == "failed" else []
        tally.count(verdict, failures + past_limits(took, grown, len(data)), took, grown, str(index))
    tally.seconds = round(time.monotonic() - start, 2)
    return tally


def _timed(reader: Reader, path: Path, data: bytes) -> tuple[str, str, float]:
    """The result of an input, and its processor time [s]: past the limit the least of several tries."""
    fastest = float("inf")
    for _ in range(_TRIES):
        began = time.process_time()
        verdict, how = try_one(reader, path, data)
        fastest = min(fastest, time.process_time() - began)
        if verdict == "failed" or fastest <= longest_s(len(data)):
            break
    return verdict, how, fastest


def longest_s(size: int) -> float:
    """The processor time [s] that an input of so many bytes may take."""
    return LONGEST_S + LONGEST_S_PER_MB * size / 1e6


def past_limits(took_s: float, grown: int, size: int) -> list[str]:
    """The resources of which an input took too much: processor time, memory."""
    found = []
    if took_s > longest_s(size):
        found.append(TOO_SLOW)
    if grown > MOST_BYTES:
        found.append(f"more than {MOST_BYTES // 10**6} MB")
    return found


# --- the parent -----------------------------------------------------------------------------------


def fuzz_all(tasks: list[_Task]) -> Iterator[Tally]:
    """Run tasks in children, one after the other; a task whose child dies goes on behind the input that ended it."""
    context = multiprocessing.get_context("spawn")
    waiting, whole = list(tasks), Tally(tasks[0].reader) if tasks else None
    with tempfile.TemporaryDirectory() as folder:
        os.environ["FUZZ_LOG"] = str(Path(folder) / "faults")
        while waiting:
            at = context.RawArray("d", 3)
            mine, theirs = context.Pipe()
            child = context.Process(target=_work, args=(waiting, theirs, at), daemon=False)
            child.start()
            theirs.close()
            done = 0
            for tally in _received(mine, child, at):
                whole.add(tally)
                yield whole
                done += 1
                if done < len(waiting):
                    whole = Tally(waiting[done].reader)
            child.join()
            waiting = waiting[done:]
            if waiting:  # it died
                waiting = _behind(waiting, int(at[1]), whole, _fault(child.exitcode))
                if not waiting or waiting[0].reader != whole.reader:
                    yield whole
                    whole = Tally(waiting[0].reader) if waiting else whole


def _received(pipe: Connection, child: "multiprocessing.process.BaseProcess", at: Sequence[float]) -> Iterator[Tally]:
    """Tallies until the child has done all, or has died; a child that hangs is ended."""
    while True:
        try:
            if pipe.poll(0.5):
                tally = pipe.recv()
                if tally is None:
                    return
                yield tally
                continue
        except (EOFError, ConnectionError):
            return
        if at[2] and time.monotonic() > at[2]:
            at[2] = 0.0
            os.kill(child.pid, 6)  # faulthandler says where


def _behind(waiting: list[_Task], index: int, whole: Tally, how: str) -> list[_Task]:
    """The remaining tasks after input `index` of the first one ended the child; the inputs before it are counted."""
    task = waiting[0]
    whole.inputs += index - task.first + 1
    whole.fail(how, str(index))
    left = task.first + task.count - index - 1
    rest = [_Task(task.reader, index + 1, left, task.seed)] if left > 0 else []
    return [*rest, *waiting[1:]]


def _fault(code: int | None) -> str:
    lines = Path(os.environ["FUZZ_LOG"]).read_text(errors="replace").splitlines()
    frames = [line.strip() for line in lines if "regents_cosim" in line][:1]
    what = {-6: "hang", -11: "segmentation fault", -9: "ended by the system"}.get(code or 0, f"exit code {code}")
    return f"{what} at {frames[0].rpartition('/')[2] if frames else 'an unknown place'}"


def tasks_of(count: int, seed: int, names: Sequence[str] = (), hostile: bool = True) -> list[_Task]:
    """`count` inputs for each reader, fewer for those that take longer."""
    found = []
    for one in readers().values():
        if not names or one.name in names:
            first = 0 if hostile else _MUTATIONS_FROM
            found.append(_Task(one.name, first, max(count // one.cost, 2), seed))
    return found


def fuzz(reader: Reader, count: int, seed: int) -> Tally:
    """`count` inputs for one reader."""
    return list(fuzz_all(tasks_of(count, seed, (reader.name,))))[-1]


# --- the command line -----------------------------------------------------------------------------


def main() -> int:
    """1 where a reader broke its promise."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=1000, help="inputs per reader")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--reader", action="append", default=[], choices=readers(), metavar="NAME",
        help="one of them; may be given more than once",
    )  # fmt: skip
    parser.add_argument("--keep", type=Path, help="folder for the inputs that failed")
    parser.add_argument("--coverage", action="store_true", help="let atheris keep the inputs that reach new lines")
    asked = parser.parse_args()
    clean, totals = True, {}
    tasks = tasks_of(asked.count, asked.seed, asked.reader)
    for tally in map(partial(_guided, keep=asked.keep), tasks) if asked.coverage else fuzz_all(tasks):
        if asked.keep and not asked.coverage:
            _keep(tally, asked.seed, asked.keep)
        clean &= tally.clean
        totals[tally.reader] = tally.inputs
        per_s = round(tally.inputs / max(tally.seconds, 1e-9))
        print(json.dumps({**asdict(tally), "per_s": per_s}), flush=True)
    print(json.dumps({"readers": len(totals), "inputs": sum(totals.values()), "clean": clean}))
    return 0 if clean else 1


def _guided(task: _Task, keep: Path | None) -> Tally:
    """Fuzz one reader under coverage guidance, in a separate process."""
    words = [task.reader, task.count, task.seed, *([keep] if keep else [])]
    command = [sys.executable, "-m", "benchmarks.endurance.guided", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace")
    if done.returncode:
        tally = Tally(task.reader)
        tally.fail(f"exit code {done.returncode}: {done.stderr.strip()[-300:]}", "")
        return tally
    return Tally(**json.loads(done.stdout.splitlines()[-1]))


def _keep(tally: Tally, seed: int, folder: Path) -> None:
    """Write the first input of each failure into `folder`."""
    for number, (what, index) in enumerate(list(tally.kept.items())):
        if index.isdigit():
            folder.mkdir(parents=True, exist_ok=True)
            file = folder / f"{tally.reader}-{seed}-{index}-{number}"
            file.write_bytes(input_of(readers()[tally.reader], seed, int(index)))
            tally.kept[what] = str(file)


if __name__ == "__main__":
    sys.exit(main())
