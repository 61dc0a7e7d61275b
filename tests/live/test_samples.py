"""With samples of changed drives and without, a live search attacks where a lawful drive crashes the ego as wanted."""

import pytest
from live_runs import run


@pytest.mark.slow
@pytest.mark.parametrize("samples", [False, True])
def test_it_attacks_with_samples_and_without(samples):
    given = {"ego": "west_in.east_out.1", "planner": "idm", "samples": samples, "attack_when": 22.95}
    found = run("libsumo", 23.95, given, seed=11, options=["--step-length", "0.1"])
    assert found["attacks"]
    assert not found["told"]
