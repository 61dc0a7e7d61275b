import gzip
import os
import tracemalloc
from contextlib import contextmanager

import pytest

from regents_cosim.checks.bounded import gunzip_bounded, open_bounded, read_bounded
from regents_cosim.errors import InputError


@contextmanager
def no_more_than(size):
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < size
    finally:
        tracemalloc.stop()


def read_stream(path, limit):
    with open_bounded(path, limit) as file:
        return file.read()


@pytest.fixture
def file(tmp_path):
    (tmp_path / "file").write_bytes(b"12345678")
    return tmp_path / "file"


@pytest.mark.parametrize("read", [read_bounded, read_stream])
def test_a_pointer_of_git_lfs_is_told_from_a_broken_file(file, read):
    file.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:38af\nsize 8005836\n")
    with pytest.raises(InputError, match=r"file is a pointer of Git LFS, .*git lfs pull"):
        read(file, 1000)


@pytest.mark.parametrize("read", [read_bounded, read_stream])
def test_a_file_of_the_allowed_size_is_read_and_one_byte_less_refuses_it(file, read):
    assert read(file, 8) == b"12345678"
    with pytest.raises(InputError, match="file holds more than 7 bytes"):
        read(file, 7)


@pytest.mark.parametrize("read", [read_bounded, read_stream])
def test_what_is_no_file_is_refused_at_once(tmp_path, read):
    os.mkfifo(tmp_path / "pipe")
    for path, words in (
        (tmp_path / "pipe", "named pipe"),
        (tmp_path, "folder"),
        ("/dev/zero", "device"),
        (tmp_path / "none", "No such file"),
        (tmp_path / ("n" * 300), "too long"),
        ("nu\0ll", "null"),
    ):
        with pytest.raises(InputError, match=words):
            read(path, 100)


def test_a_link_to_a_file_is_a_file(tmp_path, file):
    (tmp_path / "link").symlink_to(file)
    assert read_bounded(tmp_path / "link", 8) == b"12345678"


def test_gzip_that_expands_is_stopped_at_the_limit(tmp_path):
    bomb = gzip.compress(bytes(1 << 26))  # 64 MiB in 64 KiB
    (tmp_path / "bomb").write_bytes(bomb)
    with no_more_than(4 << 20):
        with pytest.raises(InputError, match="gzip data holds more than 1 MiB"):
            gunzip_bounded(bomb, 1 << 20)
        with pytest.raises(InputError, match="bomb holds more than 1 MiB"):
            read_stream(tmp_path / "bomb", 1 << 20)


def test_gzip_is_told_by_content(tmp_path, file):
    (tmp_path / "packed").write_bytes(gzip.compress(b"line\n" * 1000) + gzip.compress(b"more"))
    assert read_stream(tmp_path / "packed", 5004) == b"line\n" * 1000 + b"more"
    assert read_stream(file, 8) == b"12345678"
    assert gunzip_bounded(gzip.compress(b"abc"), 3) == b"abc"


@pytest.mark.parametrize("keep", [1, 12, -4])
def test_damaged_gzip_is_said_in_one_line(tmp_path, keep):
    data = gzip.compress(os.urandom(1000))[:keep]
    (tmp_path / "packed").write_bytes(data)
    with pytest.raises(InputError, match="gzip data is damaged or cut off") as error:
        gunzip_bounded(data, 5000)
    assert "\n" not in str(error.value)
    if keep != 1:  # one byte is not yet gzip
        with pytest.raises(InputError, match="packed: its gzip data is damaged"):
            read_stream(tmp_path / "packed", 5000)
