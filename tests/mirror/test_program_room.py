"""Compiled programs never take more of the process than there is."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from regents_cosim.mirror.programs.compiled import compiled, make_room, maps_granted, maps_taken

pytestmark = pytest.mark.skipif(maps_granted() is None, reason="the system does not tell how many maps it grants")


@compiled
def waves(values):
    return jnp.sin(values) * jnp.cos(values).sum()


@pytest.mark.slow
def test_many_shapes_take_no_more_than_half(monkeypatch):
    jax.clear_caches()
    granted = 2 * (maps_taken() + 50)
    monkeypatch.setattr("regents_cosim.mirror.programs.compiled.maps_granted", lambda: granted)
    taken = []
    for length in range(1, 20):
        values = np.linspace(0.0, 1.0, length, dtype=np.float32)
        assert waves(values).tolist() == pytest.approx((np.sin(values) * np.cos(values).sum()).tolist(), rel=1e-5)
        taken.append(maps_taken())
    assert max(taken) <= 0.5 * granted + 50  # the look before the next program is what makes room
    assert min(np.diff(taken)) < 0


def test_where_there_is_room_nothing_is_forgotten(monkeypatch):
    monkeypatch.setattr("regents_cosim.mirror.programs.compiled.maps_granted", lambda: 100 * maps_taken())
    assert not make_room()
    monkeypatch.setattr("regents_cosim.mirror.programs.compiled.maps_granted", lambda: None)
    assert not make_room()
