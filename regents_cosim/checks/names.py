"""Names that come from files, and what becomes of them: parts of paths, or ids in what is exported.

A file name (`require_file_name`) names a case, a map or an entry of a baseline: joined to a folder, it stays in it.
An id (`require_id`) names a road user, a lane or a light: any text that XML and a table can hold.
Names of our own are made by `word`, `distinct_word` and `file_name`, which keep what fits as it is.
"""

import hashlib
import re
import unicodedata
from pathlib import Path

from regents_cosim.errors import CaseError, require

# A file system takes 255 bytes, and while something is written its name is longer: `.NAME.0123abcd.old`.
MOST_BYTES = 200
_MOST_ID_BYTES = 1000
_DIGEST = 8  # characters that tell shortened names apart
_WORD = 80
_NO_TEXT = frozenset({"Cc", "Cs", "Zl", "Zp"})  # control characters, line separators, halves of characters
_NO_XML = frozenset("\ufffe\uffff")


def require_file_name(name: str, what: str) -> str:
    """`name`, if it names something in a folder and nothing outside it. Raises ScenarioError."""
    problem = _not_in_a_folder(name)
    require(
        not problem,
        f"{what} {name!r} {problem}: expected the plain name of a file or folder, of at most {MOST_BYTES} bytes",
    )
    return name


def require_id(name: str, what: str) -> str:
    """`name`, if every format that we write can hold it. Raises ScenarioError."""
    require(bool(name), f"{what} is empty: expected a name")
    require(not _no_text(name), f"{what} {name!r} holds a control character: expected letters, digits and signs")
    require(
        len(name) <= _MOST_ID_BYTES and len(name.encode()) <= _MOST_ID_BYTES,
        f"{what} {name!r} is longer than {_MOST_ID_BYTES} bytes",
    )
    return name


def require_inside(path: Path, folder: Path) -> Path:
    """`path`, if it lies in `folder` when all links are followed. Raises CaseError."""
    if not path.resolve().is_relative_to(folder.resolve()):
        raise CaseError(
            f"{path} is a link that leads out of {folder}: expected the file or folder itself (copy it there)"
        )
    return path


def require_no_link(path: Path) -> Path:
    """`path`, where what is written or removed there lies there, and not elsewhere. Raises CaseError."""
    if path.is_symlink():
        raise CaseError(f"{path} is a link, never followed for writing (remove it, or choose a new folder)")
    return path


def inside(folder: Path, *names: str) -> Path:
    """The path of these names below `folder`, which may be a link itself, where none of them is. Raises CaseError."""
    for name in names:
        folder = require_no_link(folder / name)
    return folder


def word(text: str, most: int = _WORD) -> str:
    """`text` in characters that every file system takes, `_` for those that it does not."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", text).strip(".")[:most]


def distinct_word(text: str, most: int = _WORD) -> str:
    """`text` where it is a word already, else a word that different texts do not share."""
    plain = word(text, most)
    return plain if plain == text else f"{plain}-{_digest(text)}"


def file_name(*parts: str) -> str:
    """The parts with `-` between them; where that is too long its end gives way to a digest of it."""
    name = "-".join(parts)
    data = name.encode(errors="replace")
    if len(data) <= MOST_BYTES:
        return name
    kept = data[: MOST_BYTES - _DIGEST - 1].decode(errors="ignore")
    return f"{kept}-{_digest(name)}"


def _not_in_a_folder(name: str) -> str:
    """Why `name` cannot be trusted to stay in the folder that it is joined to; empty where it can."""
    if not name:
        return "is empty"
    if "/" in name or "\\" in name:
        return "holds a / or \\"
    if name.startswith("."):
        return "begins with a dot"
    if _no_text(name):
        return "holds a control character"
    return "is too long" if len(name) > MOST_BYTES or len(name.encode()) > MOST_BYTES else ""


def _no_text(name: str) -> bool:
    return not name.isprintable() and any(unicodedata.category(c) in _NO_TEXT or c in _NO_XML for c in name)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:_DIGEST]
