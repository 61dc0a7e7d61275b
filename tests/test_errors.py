import pickle

import pytest

from regents_cosim.errors import DriveError, LogError, RegentsError, require_file


def test_a_message_is_one_short_line_of_text_whatever_it_quotes():
    error = LogError("a\nb\x1b[31m" + "c" * 100_000 + "\ud800 (what to do)")
    said = str(error)
    assert said.isprintable()
    assert len(said) <= 500
    assert said.startswith("a b\\x1b[31mccc")
    assert said.endswith("\\ud800 (what to do)")
    assert str(pickle.loads(pickle.dumps(error))) == said


@pytest.mark.parametrize("kind", [RegentsError, DriveError])
def test_raised_again_with_itself_as_the_message_it_says_the_same(kind):
    assert str(kind(kind("what to do"))) == "what to do"


def test_a_trace_keeps_its_lines():
    error = pickle.loads(pickle.dumps(DriveError("it failed", "one\ntwo")))
    assert str(error) == "it failed"


def test_a_name_too_long_for_the_file_system(tmp_path):
    with pytest.raises(RegentsError, match="cannot be looked up"):
        require_file(tmp_path / ("a" * 5000), "network")
