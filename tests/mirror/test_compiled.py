import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

from regents_cosim.mirror.lookup import look_up
from regents_cosim.mirror.programs.compiled import compiled


def test_products_are_in_full_precision_on_every_device():
    halves = jnp.ones((2, 2))
    program = compiled(lambda a, b: a @ b)
    assert "HIGHEST" in program.lower(halves, halves).lowered.as_text()
    assert "HIGHEST" not in eqx.filter_jit(lambda a, b: a @ b).lower(halves, halves).lowered.as_text()


def test_what_is_no_array_is_compiled_in():
    program = compiled(lambda values, times: values * 2.0 if times == 2 else values)
    assert program(jnp.arange(3.0), 2).tolist() == [0, 2, 4]
    assert program(jnp.arange(3.0), 1).tolist() == [0, 1, 2]


def test_an_input_can_be_given_away():
    given = jnp.arange(3.0)
    assert compiled(donate="all")(lambda values: values + 1.0)(given).tolist() == [1, 2, 3]
    with pytest.raises(RuntimeError, match="deleted"):
        given.block_until_ready()


def test_rows_are_looked_up_as_by_brackets():
    table = jnp.arange(12.0).reshape(4, 3)
    rows = jnp.array([[0, 3], [2, 2]])
    assert (look_up(table, rows) == table[rows]).all()
    slope = jax.grad(lambda values: look_up(values, rows).sum())(table)
    assert slope[:, 0].tolist() == [1, 0, 2, 1]
