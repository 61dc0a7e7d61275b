"""Text in the encodings that programs of Windows write: UTF-16, and UTF-8 with a byte order mark."""

import codecs


def encoding_of(begin: bytes) -> str:
    """The encoding of a text, known by the mark at its begin; without a mark UTF-8. Decoding by it drops the mark."""
    return "utf-16" if begin.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig"


def as_utf8(text: bytes, errors: str = "strict") -> bytes:
    """A text in UTF-8 without a mark. Raises UnicodeDecodeError for UTF-16 that is damaged."""
    if encoding_of(text) == "utf-16":
        return text.decode("utf-16", errors).encode()
    return text.removeprefix(codecs.BOM_UTF8)
