"""Where no lawful drive crashes the ego as wanted, changes of these drives are sampled, unless the search is quick."""

import pytest
from live_runs import run


@pytest.mark.slow
@pytest.mark.parametrize("quick", [True, False])
def test_samples_find_an_attack_at_a_look_at_which_no_drive_is_one(quick):
    given = {"ego": "west_in.east_out.1", "planner": "idm", "quick": quick, "attack_when": 23.95}
    found = run("libsumo", 24.15, given, seed=11, options=["--step-length", "0.1"])
    assert found["attacks"] == (0 if quick else 1)
    assert found["state"] == ("watching" if quick else "attacking")
    assert not found["told"]
