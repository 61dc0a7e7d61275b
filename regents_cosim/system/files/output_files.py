"""Files that the user names and this package makes: pages, tables, pictures, weights, logs.

Each has a mark in its first bytes. So an existing file is either recognised as ours or left as it is; no other file is
ever overwritten.
"""

import os
from pathlib import Path

from regents_cosim.errors import RegentsError
from regents_cosim.system.files.atomic import explain_write, require_writable, write_atomic

MARK = "made by regents_cosim"
_HEAD_BYTES = 4096  # bytes that contain the mark: a GIF has its palette before it


def require_ours(path: Path) -> None:
    """Raise RegentsError if something that this package did not make is at `path`; an empty file may be replaced."""
    if not os.path.lexists(path):
        return
    if path.is_symlink() or not path.is_file():
        what = "is a link" if path.is_symlink() else "is a folder" if path.is_dir() else "is no file"
        raise RegentsError(f"{path} {what}, expected the name of a new file, or of one that regents_cosim made")
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError as error:
        raise RegentsError(
            f"{path} cannot be read to see whose it is: {error.strerror} (choose another name)"
        ) from error
    if head and MARK.encode() not in head:
        raise RegentsError(
            f"{path} exists and is not {MARK}, so it is left as it is (choose another name, or remove it)"
        )


def require_output(path: Path) -> None:
    """Raise RegentsError, before the work whose result it will hold, where `write_output_file` would fail."""
    require_writable(path.parent)
    require_ours(path)


def write_output_file(path: Path, content: bytes) -> None:
    """Write `content`, which has the mark, as a whole or not at all. Raises RegentsError as `require_ours` does."""
    assert MARK.encode() in content[:_HEAD_BYTES]
    require_ours(path)
    with explain_write(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, content)
