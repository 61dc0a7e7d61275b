"""Make text from outside safe to print: printable characters only, and a limited number of them.

Names, paths and messages of planners may hold anything: escape sequences that control the terminal, marks that reverse
the direction of writing, half a surrogate pair, 50 MB. They are shown, and never take effect.
"""

import unicodedata
from collections.abc import Sequence

MESSAGE_LIMIT = 500
_ELLIPSIS = " ... "
# Characters that control a terminal: control characters, line and paragraph separators; surrogates cannot be encoded.
_UNSHOWABLE = frozenset({"Cc", "Cs", "Zl", "Zp"})
# Marks that change the direction of the text after them, and with it what a line seems to say.
_TURNING = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
_SHORT = {"\n": "\\n", "\r": "\\r", "\t": "\\t"}


def printable(text: str, limit: int | None = MESSAGE_LIMIT) -> str:
    r"""`text` on one line, control characters escaped (`\x1b`), cut in the middle to at most `limit` characters."""
    if limit is None:
        return _escaped(text)
    if len(text) > 2 * limit:  # escapes only lengthen it: what lies further from both ends cannot be seen
        text = text[:limit] + text[-limit:]
    return _shortened(_escaped(text), limit)


def one_line(text: str) -> str:
    """`text` as one line: line breaks and runs of blanks become one blank, then `printable` is applied."""
    return printable(" ".join(text.split()))


def listed(names: Sequence[str], most: int) -> str:
    """The first `most` names, comma-separated, and the number of the remaining ones."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(names[:most])}{more}"


def all_named(names: Sequence[str]) -> str:
    """All names: "a", "a and b", "a, b and c"."""
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def counted(number: int, noun: str) -> str:
    """A number with its noun, in the plural unless it is one: "1 case", "2 cases", "0 crashes"."""
    return f"{number} {noun if number == 1 else noun + ('es' if noun.endswith('sh') else 's')}"


def wrapped(text: str, width: int) -> str:
    """A text in lines that are broken between words; of more than `width` where one word is longer."""
    return "\n".join(line for paragraph in text.split("\n") for line in _lines(paragraph, width))


def _lines(paragraph: str, width: int) -> list[str]:
    from rich.cells import cell_len

    first, *words = paragraph.split(" ")
    lines = [first]
    for word in words:
        longer = f"{lines[-1]} {word}"
        if cell_len(longer) <= width or not lines[-1].strip():
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


def _escaped(text: str) -> str:
    return text if text.isprintable() else "".join(map(_escaped_character, text))


def _escaped_character(character: str) -> str:
    if unicodedata.category(character) not in _UNSHOWABLE and character not in _TURNING:
        return character
    code = ord(character)
    return _SHORT.get(character) or (f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}")


def _shortened(text: str, limit: int) -> str:
    """Cut out the middle of the text, because the end of a message says what to do."""
    if len(text) <= limit:
        return text
    kept = max(limit - len(_ELLIPSIS), 0)
    end = kept // 3
    return (text[: kept - end] + _ELLIPSIS + text[len(text) - end :])[:limit]
