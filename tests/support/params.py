"""Sets of parameters that only `make test-all` runs."""

import pytest


def slow(*values, **more):
    return pytest.param(*values, marks=pytest.mark.slow, **more)
