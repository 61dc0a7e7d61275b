import unicodedata

from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.plain_text import all_named, counted, one_line, printable

# Half of a character (surrogates) is part of file names that are no UTF-8.
ANYTHING = st.text(st.characters(codec=None), max_size=60)


@given(ANYTHING, st.none() | st.integers(0, 40))
def test_it_holds_nothing_that_a_terminal_obeys(text, limit):
    shown = printable(text, limit)
    assert not {"Cc", "Cs", "Zl", "Zp"} & {unicodedata.category(character) for character in shown}
    assert not set(shown) & set("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
    shown.encode()


@given(ANYTHING, st.integers(0, 40))
def test_it_keeps_the_limit_and_changes_nothing_twice(text, limit):
    shown = printable(text, limit)
    assert len(shown) <= limit
    assert printable(shown, limit) == shown


@given(st.text(st.characters(categories=["L", "M", "N", "P", "S"]), max_size=40))
def test_ordinary_text_stays_as_it_is(text):
    assert printable(text, 40) == text


@given(ANYTHING, st.integers(0, 40))
def test_the_length_before_the_cut_changes_nothing_that_is_seen(text, limit):
    assert printable(text + "x" * 200, limit)[: limit // 2] == printable(text + "x" * 300, limit)[: limit // 2]


@given(ANYTHING)
def test_a_message_is_one_sentence(text):
    shown = one_line(text)
    assert "  " not in shown
    assert shown == shown.strip()


def test_examples():
    assert printable("\x1b[31mred\x07\n") == r"\x1b[31mred\x07\n"
    assert printable("undecodable \udcff, turned \u202e") == r"undecodable \udcff, turned \u202e"
    assert printable("Straße 東京 👍🏽 a\u0301") == "Straße 東京 👍🏽 a\u0301"
    assert one_line("found this,\n  do that") == "found this, do that"


def test_the_middle_of_50_mb_goes_and_both_ends_stay():
    shown = printable("what was found: " + "\x00" * 50_000_000 + ", do this")
    assert shown.startswith("what was found: ")
    assert shown.endswith(", do this")
    assert len(shown) == 500


def test_names_are_listed_as_one_says_them():
    assert [all_named("abc"[:count]) for count in range(4)] == ["", "a", "a and b", "a, b and c"]


def test_a_noun_is_in_the_plural_unless_it_is_one():
    assert [counted(number, "crash") for number in (0, 1, 2)] == ["0 crashes", "1 crash", "2 crashes"]
    assert counted(3, "case") == "3 cases"
