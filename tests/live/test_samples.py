"""Where no lawful drive crashes the ego as wanted, changes of these drives are sampled."""

import pytest
from live_runs import run


@pytest.mark.slow
@pytest.mark.parametrize("samples", [False, True])
def test_samples_find_an_attack_where_no_drive_is_one(samples):
    given = {"ego": "west_in.east_out.1", "planner": "idm", "samples": samples, "attack_when": 23.95}
    found = run("libsumo", 24.95, given, seed=11, options=["--step-length", "0.1"])
    assert found["attacks"] == samples
    assert not found["told"]
