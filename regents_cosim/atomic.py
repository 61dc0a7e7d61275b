"""Writing that a killed run cannot leave half-done: a temporary name, then a rename."""

import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from regents_cosim.errors import RegentsError


@contextmanager
def new_folder(target: Path) -> Iterator[Path]:
    """A folder under a temporary name that takes the place of `target` when the block succeeds."""
    folder = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    try:
        yield folder
        folder.chmod(0o755)
        old = target.with_name(f".{target.name}.{secrets.token_hex(4)}.old")
        if target.exists():
            target.rename(old)
        folder.rename(target)
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def write_atomic(path: Path, content: bytes) -> None:
    """Write `content` to `path` as a whole or not at all."""
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        temporary.write_bytes(content)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def require_writable(folder: Path) -> None:
    """Raise RegentsError now where `folder` cannot be made or written later; makes nothing."""
    existing = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        raise RegentsError(
            f"cannot write to {folder}: {existing} is no folder we may write to (choose another with -o)"
        )


@contextmanager
def explain_write(folder: Path) -> Iterator[None]:
    """Turn the system's refusal to write into an error that names the folder."""
    try:
        yield
    except OSError as error:
        raise RegentsError(f"cannot write to {folder}: {error.strerror} (choose another folder with -o)") from error
