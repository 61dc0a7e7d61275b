"""CMA-ES works without the optional dependencies of its package, and leaves them importable by other modules."""

import subprocess
import sys

import pytest

LOOKS = """
import sys
import numpy as np
from regents_cosim.attacks.sampling.sampled_search import cma_es
search = cma_es(np.zeros(3), 0.5, 6, seed=1)
assert "scipy.stats" not in sys.modules
for _ in range(60):
    changes = [search.ask() for _ in range(6)]
    search.tell([(change, float(((change - 1.0) ** 2).sum())) for change in changes])
assert np.abs(search.mean - 1.0).max() < 0.05, search.mean
from scipy.stats import norm
assert norm.cdf(0.0) == 0.5
assert np.array_equal(cma_es(np.zeros(3), 0.5, 6, seed=1).ask(), cma_es(np.zeros(3), 0.5, 6, seed=1).ask())
"""


@pytest.mark.slow
def test_it_finds_a_minimum_and_leaves_scipy_as_it_was():
    subprocess.run([sys.executable, "-c", LOOKS], check=True)
