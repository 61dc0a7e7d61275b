import json
import os
from dataclasses import dataclass
from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from scenes import platoon

from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.methods.presets import METHODS
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.traces import (
    NoOutlineError,
    keep_traced_programs,
    outline,
    rebuild,
    traced,
    version_of,
)
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.idm import IDM
from regents_cosim.system.edited_code import is_edited


@pytest.fixture
def kept(tmp_path):
    """The folder that traces are kept in."""
    RUNS.clear()
    keep_traced_programs(tmp_path / "traced")
    yield tmp_path / "traced"
    keep_traced_programs(None)


@dataclass(frozen=True)
class Foreign:
    """A value of somebody else."""

    factor: float = 2.0


def in_a_new_process(function, *given, **named):
    """The result in a new process that has traced nothing yet."""
    arrays, rest = eqx.partition((given, named), eqx.is_array)
    out = []

    def program(arrays):
        given, named = eqx.combine(arrays, rest)
        made, other = eqx.partition(traced(function, given, named), eqx.is_array)
        out.append(other)
        return made

    made = jax.jit(program)(arrays)
    return eqx.combine(made, out[0])


RUNS = []  # of the functions below: their traces add nothing


def ours(function):
    """Let a function appear to be defined in the package."""
    function.__module__ = "regents_cosim.made_for_a_test"
    return function


@ours
def scaled(values, factor):
    RUNS.append(factor)
    return (values[0] if isinstance(values, list) else values) * factor


@ours
def moved(values, factor, offset):
    RUNS.append(factor)
    return values * factor + offset, [None, "done", factor]


@ours
def same(values, given):
    RUNS.append(given)
    return values


@ours
def with_something_foreign(values):
    return values, Foreign()


@ours
def told(values):
    return jax.pure_callback(lambda v: np.asarray(v) + 1, jax.ShapeDtypeStruct((3,), jnp.float32), values)


def adding(given):
    return lambda values: values + given


def files(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_a_program_is_traced_once(kept):
    for _ in range(3):
        values, said = in_a_new_process(moved, jnp.arange(3.0), 2.0, offset=jnp.float32(1.0))
        assert (values.tolist(), said) == ([1, 3, 5], [None, "done", 2.0])
    assert len(RUNS) == 1
    assert len(files(kept)) == 1


def test_what_it_depends_on_gives_another_trace(kept):
    values = jnp.arange(3.0)
    for given in (
        (values, 2.0), (values, 3.0), (values, 2), (values, True), (values[:2], 2.0), (jnp.arange(3), 2.0),
        (values, jnp.float32(2.0)), (values, jnp.asarray(2.0)), ([values], jnp.float32(2.0)),
    ):  # fmt: skip
        first, again = (in_a_new_process(scaled, *given) for _ in range(2))
        assert first.tolist() == again.tolist()
    with jax.enable_x64(True):
        in_a_new_process(scaled, values, 2.0)
    assert len(RUNS) == len(files(kept)) == 10


@pytest.mark.parametrize("given", [Foreign(), lambda values: values, object()], ids=["value", "function", "object"])
def test_what_is_somebody_else_s_is_traced_every_time(kept, given):
    for _ in range(2):
        in_a_new_process(same, jnp.arange(3.0), given)
    assert len(RUNS) == 2
    assert not kept.exists()


def test_so_is_a_function_that_says_not_all_it_does(kept):
    for factor in (2.0, 3.0):
        nameless, holding = ours(lambda values, by=factor: values * by), ours(adding(factor))
        holding.__qualname__ = "holding"
        assert in_a_new_process(nameless, jnp.ones(1)).tolist() == [factor]
        assert in_a_new_process(holding, jnp.ones(1)).tolist() == [1 + factor]
    assert in_a_new_process(lambda values: values + 1, jnp.ones(1)).tolist() == [2.0]
    assert not kept.exists()


def test_so_is_what_returns_something_foreign(kept):
    made = in_a_new_process(with_something_foreign, jnp.arange(3.0))
    assert made[1] == Foreign()
    assert files(kept) == []


def test_and_what_asks_the_host(kept):
    assert in_a_new_process(told, jnp.arange(3.0)).tolist() == [1, 2, 3]
    assert files(kept) == []


@pytest.mark.parametrize("length", [0, 1, 40, 64, 65, 66, 70, 200, -1])
def test_a_damaged_file_is_as_good_as_none(kept, length):
    for _ in range(3):
        assert in_a_new_process(scaled, jnp.arange(3.0), 2.0).tolist() == [0, 2, 4]
        (file,) = files(kept)
        whole = file.read_bytes()
        file.write_bytes(whole[:length])
    assert len(RUNS) == 3
    file.write_bytes(whole.replace(b"array", b"arrow"))
    assert in_a_new_process(scaled, jnp.arange(3.0), 2.0).tolist() == [0, 2, 4]
    assert len(RUNS) == 4


def test_where_nothing_can_be_written_nothing_is_kept(tmp_path):
    (tmp_path / "file").write_text("in the way")
    keep_traced_programs(tmp_path / "file")
    assert in_a_new_process(scaled, jnp.arange(3.0), 2.0).tolist() == [0, 2, 4]
    keep_traced_programs(None)


def test_other_code_is_another_version(tmp_path):
    seen = [version_of(tmp_path / "nothing")]
    for name, text in (("a.py", "1"), ("a.py", "2"), ("b.py", "1"), ("c/b.py", "1"), ("c/b.py", "")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
        version_of.cache_clear()
        seen.append(version_of(tmp_path))
    assert all(a != b for a, b in pairwise(seen))
    assert len(set(seen)) == len(seen)


def test_versions_long_gone_are_dropped(kept):
    for number in range(9):
        (kept / f"version{number}").mkdir(parents=True)
    in_a_new_process(scaled, jnp.arange(3.0), 2.0)
    assert len(list(kept.iterdir())) == 4
    assert len(files(kept)) == 1


@pytest.mark.parametrize(
    "tree",
    [
        *METHODS.values(),
        IDM(),
        to_world(platoon()),
        SearchedAgents.only(1, 8),
        optax.adam(1e-3).init(jnp.zeros(3)),
        float("inf"),
        compiled,
    ],
    ids=lambda tree: type(tree).__name__,
)
def test_an_outline_is_all_but_the_arrays(tree):
    arrays = []
    plain = json.loads(json.dumps(outline(tree, arrays)))
    assert eqx.tree_equal(rebuild(plain, iter(arrays)), tree)


def test_what_its_own_name_does_not_lead_to_has_no_outline():
    with pytest.raises(NoOutlineError, match="Hidden is not a name"):
        outline(type("Hidden", (), {"__module__": "regents_cosim.mirror.world"}), [])


@pytest.mark.parametrize("name", ["os:system", "subprocess:Popen", "regents_cosimilar:x", "builtins:eval"])
def test_only_names_of_the_package_are_looked_up(name):
    for plain in ({"name": name}, {"of": name, "fields": []}):
        with pytest.raises(NoOutlineError, match="is not a name of the package's"):
            rebuild(plain, iter(()))


def test_code_that_was_edited_since_it_was_read_is_noticed(tmp_path):
    (tmp_path / "edited.py").write_text("")
    os.utime(tmp_path / "edited.py", (2e10, 2e10))
    assert is_edited(tmp_path)
    is_edited.cache_clear()
    os.utime(tmp_path / "edited.py", (0, 0))
    assert not is_edited(tmp_path)
