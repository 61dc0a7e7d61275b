"""Tables fit the terminal: columns by what matters, none wider than there is room for."""

from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from regents_cosim.cli.terminal import GAP, Column, ends, fit, laid_out
from regents_cosim.plain_text import wrapped

WORDS = st.text(st.characters(categories=["L", "N"]), min_size=1, max_size=12)
NARROW = WORDS.filter(lambda word: cell_len(word) <= 12)  # some letters are two columns wide
COLUMNS = st.dictionaries(
    WORDS, st.builds(Column, WORDS, st.lists(st.text(max_size=90), max_size=4)), min_size=1, max_size=12
)


def total(widths):
    return sum(widths.values()) + GAP * (len(widths) - 1)


@given(COLUMNS, st.integers(60, 300), st.data())
def test_no_table_is_wider_than_the_terminal(columns, room, data):
    essential = data.draw(st.lists(st.sampled_from(sorted(columns)), unique=True))
    widths = fit(columns, essential, room)
    assert total(widths) <= room
    assert list(widths) == [key for key in columns if key in widths]
    assert (essential or list(columns))[0] in widths


@given(COLUMNS)
def test_where_there_is_room_everything_is_whole(columns):
    widths = fit(columns, (), 10_000)
    assert list(widths) == list(columns)
    assert all(cell_len(cell) <= widths[key] for key, column in columns.items() for cell in column.cells)


def test_essential_columns_come_in_first_and_names_break_where_they_must():
    columns = {
        "case": Column("case", [60 * "c"]),
        "iterations": Column("iterations", ["17"]),
        "note": Column("note", [70 * "n"]),
        "clean": Column("clean", ["yes"]),
    }
    assert fit(columns, ("case", "clean"), 80) == {"case": 60, "iterations": 10, "clean": 5}
    assert fit(columns, ("case", "clean"), 60) == {"case": 41, "iterations": 10, "clean": 5}
    assert fit(columns, ("case", "clean"), 31) == {"case": 24, "clean": 5}


def test_columns_that_are_all_essential_break_before_one_is_left_out():
    methods = {name: Column(name, [90 * name[0]]) for name in ("king", "regents", "focused")}
    columns = {"": Column("", ["windows without a telling crash"]), **methods}
    assert list(fit(columns, list(columns), 80)) == list(columns)


@given(st.text(st.characters(categories=["L", "N", "P"]), min_size=1, max_size=120), st.integers(3, 60))
def test_a_name_is_whole_or_shown_by_its_ends(name, width):
    shown = ends(name, width)
    assert cell_len(shown) <= width
    begin, _, end = shown.partition("…") if shown != name else (name, "", "")
    assert name.startswith(begin)
    assert name.endswith(end)


@given(st.lists(NARROW, max_size=12), st.integers(16, 60))
def test_no_word_is_broken(words, width):
    lines = laid_out(" ".join(words), width).split("\n")
    assert [word for line in lines for word in line.split()] == words  # of at most 12 columns: all are whole
    assert all(cell_len(line) <= width for line in lines)


@given(st.lists(st.lists(st.text(st.characters(categories=["L", "N"]), min_size=1, max_size=90)), min_size=1))
def test_a_note_breaks_between_words_alone(paragraphs):
    text = "\n".join(map(" ".join, paragraphs))
    lines = wrapped(text, 60).split("\n")
    assert [word for line in lines for word in line.split(" ") if word] == text.split()
    assert all(cell_len(line) <= 60 or " " not in line for line in lines)
    assert len(lines) >= len(paragraphs)


def test_names_of_one_column_stay_apart():
    others = ("north_in.south_out.1", "west_in.south_out.1", "west_in.south_out.12")
    names = [f"crossing-00{at}.0s-east_in.west_out.7-focused-idm-{one}" for at in (100, 200) for one in others]
    column = Column("case", names)
    width = fit({"case": column, "kind": Column("kind", 6 * [40 * "x"])}, ("case", "kind"), 80)["case"]
    assert width < len(names[0])
    assert len(set(column.within(width).cells)) == len(names)
