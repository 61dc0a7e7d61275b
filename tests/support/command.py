"""The command `regents`, as a user starts it."""

import os
import subprocess
import sys
from pathlib import Path

REGENTS = Path(sys.executable).with_name("regents")


def regents(
    *words: object, cwd: Path | None = None, code: int | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run the command to its end, with the exit code `code` where one is given; it never shows a traceback."""
    done = subprocess.run(
        [REGENTS, *map(str, words)], capture_output=True, text=True, cwd=cwd, env=os.environ | environment
    )
    assert "Traceback" not in done.stderr, done.stderr
    assert code in (None, done.returncode), (done.returncode, done.stderr)
    return done
