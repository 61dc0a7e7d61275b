"""Files that a user names: ours is written over, all else stays as it is."""

import os

import pytest

from regents_cosim.errors import RegentsError
from regents_cosim.system.files.output_files import MARK, require_ours, write_output_file

OURS = f"<!-- {MARK} -->\n".encode()


def test_a_new_file_an_empty_one_and_one_of_ours_are_written(tmp_path):
    (tmp_path / "empty").touch()
    (tmp_path / "ours").write_bytes(OURS + b"old")
    for name in ("new", "empty", "ours"):
        write_output_file(tmp_path / name, OURS + b"now")
        assert (tmp_path / name).read_bytes() == OURS + b"now"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "new", "ours"]


@pytest.mark.parametrize("content", [b"import regents_cosim\n", b"{}", b" ", b"\0" * 5000 + OURS])
def test_what_is_not_ours_is_left_as_it_is(content, tmp_path):
    path = tmp_path / "theirs"
    path.write_bytes(content)
    with pytest.raises(RegentsError, match="is not made by regents_cosim.*choose another name"):
        write_output_file(path, OURS)
    assert path.read_bytes() == content


def _link(path):
    (path.parent / "target").write_bytes(OURS)
    path.symlink_to("target")


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (_link, "is a link"),
        (lambda path: path.symlink_to("nowhere"), "is a link"),
        (lambda path: path.mkdir(), "is a folder"),
        (os.mkfifo, "is no file"),
    ],
)
def test_what_is_no_file_is_never_replaced(make, said, tmp_path):
    make(tmp_path / "it")
    before = (tmp_path / "it").lstat()
    with pytest.raises(RegentsError, match=said):
        require_ours(tmp_path / "it")
    with pytest.raises(RegentsError, match=said):
        write_output_file(tmp_path / "it", OURS)
    assert (tmp_path / "it").lstat().st_ino == before.st_ino
