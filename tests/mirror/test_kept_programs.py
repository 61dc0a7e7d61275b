"""The folder of compiled programs is for its owner alone, bounded, and free of what a kill has cut off."""

import os
import subprocess
import sys
import zlib
from importlib.util import find_spec

import pytest

from regents_cosim.errors import RegentsError
from regents_cosim.mirror.programs.compile_cache import private_folder, tidy

pytestmark = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="modes of POSIX")


def test_a_new_folder_is_for_its_owner_alone(tmp_path):
    before = os.umask(0)
    try:
        folder = private_folder(tmp_path / "kept")
    finally:
        os.umask(before)
    assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("mode", [0o777, 0o775, 0o722])
def test_a_folder_that_others_can_write_is_refused(tmp_path, mode):
    folder = tmp_path / "kept"
    folder.mkdir()
    folder.chmod(mode)
    with pytest.raises(RegentsError, match="can be written by others") as error:
        private_folder(folder)
    assert "\n" not in str(error.value)


def test_a_folder_that_others_can_replace_is_refused(tmp_path):
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    with pytest.raises(RegentsError, match="which all users can write to"):
        private_folder(tmp_path / "open" / "kept")
    (tmp_path / "open").chmod(0o1777)  # as /tmp is: there no user can replace what belongs to others
    private_folder(tmp_path / "open" / "kept")


def test_a_link_is_judged_by_where_it_leads(tmp_path):
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    (tmp_path / "kept").symlink_to(tmp_path / "open")
    with pytest.raises(RegentsError, match="can be written by others"):
        private_folder(tmp_path / "kept")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give files away")
def test_a_folder_of_another_user_is_refused(tmp_path):
    folder = private_folder(tmp_path / "kept")
    os.chown(folder, 12345, -1)
    with pytest.raises(RegentsError, match="belongs to user 12345"):
        private_folder(folder)


def test_what_was_used_longest_ago_goes_first(tmp_path):
    (tmp_path / "compiled").mkdir()
    for age, name in enumerate(("new", "compiled/old", "older", "oldest")):
        (tmp_path / name).write_bytes(b"x" * 100)
        os.utime(tmp_path / name, (1e9 - age, 1e9 - age))
    tidy(tmp_path, limit_bytes=250)
    assert {path.name for path in tmp_path.rglob("*") if path.is_file()} == {"new", "old", ".checked"}


def test_entries_that_a_kill_has_cut_off_are_removed(tmp_path):
    whole = zlib.compress(os.urandom(1000))
    for name, content in (("whole-cache", whole), ("cut-cache", whole[:-100]), ("empty-cache", b"")):
        (tmp_path / name).write_bytes(content)
    tidy(tmp_path)
    assert [path.name for path in tmp_path.iterdir() if path.name.endswith("-cache")] == ["whole-cache"]


OURS_AMONG_THE_USERS = """
import sys
import jax
if sys.argv[1:]:
    jax.config.update("jax_compilation_cache_dir", sys.argv[1])
assert jax.jit(lambda x: x + 1)(41) == 42
import jax.numpy as jnp
from regents_cosim.mirror.programs.compiled import compiled
print(compiled(lambda x: x + 1)(jnp.ones(3)).tolist())
assert jax.jit(lambda x: x + 2)(40) == 42
"""


def programs_in(folder):
    return len(list(folder.glob("*-cache"))) if folder.exists() else 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cache", "of_the_user", "where"), [("kept", "", "kept/compiled"), ("kept", "theirs", "theirs"), ("off", "", None)]
)
def test_programs_are_kept_from_python_too_unless_the_user_says_otherwise(tmp_path, cache, of_the_user, where):
    folder = cache if cache == "off" else str(tmp_path / cache)
    given = [str(tmp_path / of_the_user)] if of_the_user else []
    # the user's choice of what is worth keeping stands as well, which is by default a second of compilation
    environment = os.environ | {"REGENTS_CACHE": folder}
    if of_the_user:
        environment["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    done = subprocess.run(
        [sys.executable, "-c", OURS_AMONG_THE_USERS, *given], env=environment, capture_output=True, text=True
    )
    assert (done.stdout, done.stderr) == ("[2.0, 2.0, 2.0]\n", "")
    places = {"kept/compiled", "theirs"}
    assert {name for name in places if programs_in(tmp_path / name)} == ({where} if where else set())


COMPILE = """
import jax
from regents_cosim.mirror.programs.compile_cache import keep_compiled_programs
keep_compiled_programs()
print(jax.jit(lambda x: x + 1)(41))
"""


@pytest.mark.slow
@pytest.mark.skipif(
    bool(find_spec("zstandard")) or sys.version_info >= (3, 14),
    reason="JAX packs with zstandard, and no entry is checked",
)
def test_a_cut_off_entry_of_jax_is_made_again_without_a_word(tmp_path):
    environment = os.environ | {"REGENTS_CACHE": str(tmp_path / "kept")}
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", COMPILE], env=environment, capture_output=True, text=True)
        assert (done.stdout, done.stderr) == ("42\n", "")
        entries = list((tmp_path / "kept" / "compiled").glob("*-cache"))
        assert entries
        for entry in entries:
            zlib.decompress(entry.read_bytes())
            entry.write_bytes(entry.read_bytes()[:100])
