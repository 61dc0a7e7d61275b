"""Values of the host on the device: copied where others may write to them, else used where they lie."""

import jax
import numpy as np
import pytest

from regents_cosim.mirror.programs.on_device import empty_for_device, handed_over, on_device


def test_a_copy_does_not_follow_its_original():
    values = np.arange(4.0)
    copied = on_device(values, np.float32)
    values[:] = 9.0
    assert copied.dtype == np.float32
    assert copied.tolist() == [0.0, 1.0, 2.0, 3.0]


@pytest.mark.parametrize("shape", [(1,), (7, 4), (2**16, 4)])
def test_what_is_handed_over_is_not_copied(shape):
    values = empty_for_device(shape, np.float32)
    assert values.shape == shape
    assert values.dtype == np.float32
    values[:] = 3.0
    there = handed_over(values)
    assert (np.asarray(there) == 3.0).all()
    if jax.default_backend() == "cpu":
        assert there.unsafe_buffer_pointer() == values.ctypes.data
