"""Coverage-guided fuzzing of one reader with atheris (libFuzzer): `fuzz --coverage` starts it for each.

Inputs that reach new lines of the package are kept and mutated further, half of the time as `fuzz` mutates, half of the
time as libFuzzer does. The tally is printed as one line of JSON. atheris is installed for it alone:
`pip install atheris`.
"""

import json
import os
import random
import sys
import tempfile
import time
import warnings
from dataclasses import asdict
from pathlib import Path

_LARGEST = 1 << 16  # bytes of an input: larger ones are what `fuzz` is for


def guided(name: str, count: int, seed: int, keep: Path | None) -> None:
    """Does not come back: libFuzzer ends the process."""
    import atheris

    with atheris.instrument_imports(include=["regents_cosim"]):
        from benchmarks.endurance.fuzz import Tally, mutated, past_limits, place, try_one
        from benchmarks.endurance.readers import readers
    from tests.support.peak_memory import peak_bytes

    warnings.simplefilter("error", RuntimeWarning)
    warnings.filterwarnings("ignore", category=UserWarning)
    reader = readers()[name]
    folder, corpus = Path(tempfile.mkdtemp()), Path(tempfile.mkdtemp())
    path, tally, most, start = place(reader, folder), Tally(name), peak_bytes(), time.monotonic()
    for number, content in enumerate(reader.seeds):
        (corpus / f"seed{number}").write_bytes(content)

    def one(data: bytes) -> None:
        nonlocal most
        began, content = time.process_time(), reader.wrap(data)
        verdict, how = try_one(reader, path, content)
        failures = [how] if verdict == "failed" else []
        took, grown = time.process_time() - began, max(peak_bytes() - most, 0)
        most += grown
        tally.count(verdict, [*failures, *past_limits(took, grown, len(content))], took, grown, str(tally.inputs))
        if len(tally.kept) > len(known) and keep:
            keep.mkdir(parents=True, exist_ok=True)
            (keep / f"{name}-guided-{len(known)}").write_bytes(content)
        known.update(tally.kept)
        if tally.inputs >= count:
            tally.seconds = round(time.monotonic() - start, 2)
            print(json.dumps(asdict(tally)), flush=True)
            os._exit(0)

    def mutate(data: bytes, largest: int, number: int) -> bytes:
        rng = random.Random(number)
        if rng.random() < 0.5:
            return mutated([data, *reader.seeds], rng)[:largest]
        return atheris.Mutate(data, largest)

    known: set[str] = set()
    options = [f"-seed={seed + 1}", f"-max_len={_LARGEST}", "-verbosity=0", "-rss_limit_mb=0", "-timeout=120"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], one, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    guided(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]) if sys.argv[4:] else None)
