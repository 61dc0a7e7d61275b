"""Check names that come from files before they become parts of paths or ids in exports.

A file name (`require_file_name`) names a case, a map or an entry of a baseline; joined to a folder, the path stays in
that folder. An id (`require_id`) names a road user, a lane or a light; it is any text that XML and a table can hold.
`word`, `distinct_word` and `file_name` make such names, and leave text that fits unchanged.
"""

import difflib
import hashlib
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from regents_cosim.errors import CaseError, RegentsError, require

# A file system takes 255 bytes, and the temporary name of a file is longer than its own: `.NAME.0123abcd.old`.
MOST_BYTES = 200
_MOST_ID_BYTES = 1000
_DIGEST = 8  # hex digits that tell shortened names apart
_WORD = 80
_NO_TEXT = frozenset({"Cc", "Cs", "Zl", "Zp"})  # control characters, line separators, halves of characters
_NO_XML = frozenset("\ufffe\uffff")


def require_file_name(name: str, what: str) -> str:
    """Return `name` if it names something directly in a folder. Raises ScenarioError otherwise."""
    problem = _not_in_a_folder(name)
    require(
        not problem,
        f"{what} {name!r} {problem}: expected the plain name of a file or folder, of at most {MOST_BYTES} bytes",
    )
    return name


def require_id(name: str, what: str) -> str:
    """Return `name` if every export format can hold it. Raises ScenarioError otherwise."""
    require(bool(name), f"{what} is empty: expected a name")
    require(not _no_text(name), f"{what} {name!r} holds a control character: expected letters, digits and signs")
    require(
        len(name) <= _MOST_ID_BYTES and len(name.encode()) <= _MOST_ID_BYTES,
        f"{what} {name!r} is longer than {_MOST_ID_BYTES} bytes",
    )
    return name


def require_distinct(cases: Iterable[str]) -> None:
    """Raise RegentsError where two cases have the same id, so that a result by id would hide one of them."""
    for case, times in Counter(cases).items():
        if times > 1:
            raise RegentsError(f"case {case!r} occurs {times} times, expected ids that differ")


def lies_in(path: Path, folder: Path) -> bool:
    """Whether `path` lies in `folder` after all links are followed; of links in a circle it is their own place."""
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))


def require_inside(path: Path, folder: Path) -> Path:
    """Return `path` if it lies in `folder` after all links are followed. Raises CaseError otherwise."""
    if not lies_in(path, folder):
        raise CaseError(
            f"{path} is a link that leads out of {folder}: expected the file or folder itself (copy it there)"
        )
    return path


def require_no_link(path: Path) -> Path:
    """Return `path` if it is not a link, so that writing or removing it changes nothing elsewhere. Raises CaseError."""
    if path.is_symlink():
        raise CaseError(f"{path} is a link, never followed for writing (remove it, or choose a new folder)")
    return path


def inside(folder: Path, *names: str) -> Path:
    """The path of `names` below `folder`. Raises CaseError where one of them is a link; `folder` itself may be one."""
    for name in names:
        folder = require_no_link(folder / name)
    return folder


def word(text: str, most: int = _WORD) -> str:
    """`text` with every run of characters that a file system may refuse replaced by `_`."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", text).strip(".")[:most]


def distinct_word(text: str, most: int = _WORD) -> str:
    """`text` if it is a word already, otherwise a word with a digest, so that different texts never share one."""
    plain = word(text, most)
    return plain if plain == text else f"{plain}-{_digest(text)}"


def file_name(*parts: str) -> str:
    """The parts joined by `-`; the end of a name that is too long is replaced by a digest of the whole name."""
    name = "-".join(parts)
    data = name.encode(errors="replace")
    if len(data) <= MOST_BYTES:
        return name
    kept = data[: MOST_BYTES - _DIGEST - 1].decode(errors="ignore")
    return f"{kept}-{_digest(name)}"


def _not_in_a_folder(name: str) -> str:
    """The reason why `name` may lead out of the folder that it is joined to; empty where there is none."""
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


_NEAR = 0.6  # least similarity of a suggestion, from 0 to 1


def nearest(name: str, known: Iterable[str], number: int = 1) -> list[str]:
    """Up to `number` known names similar to `name`, upper and lower case alike; empty where none is similar."""
    by_small = {one.lower(): one for one in known}
    return [by_small[one] for one in difflib.get_close_matches(name.lower(), list(by_small), number, _NEAR)]


def did_you_mean(name: str, known: Iterable[str], prefix: str = "") -> str:
    """A hint such as `did you mean merge?`, or the full list where no name is similar; `prefix` precedes names."""
    among = tuple(known)
    if near := nearest(name, among, 3):
        return f"did you mean {' or '.join(prefix + one for one in near)}?"
    return f"expected one of {', '.join(prefix + one for one in among)}"
