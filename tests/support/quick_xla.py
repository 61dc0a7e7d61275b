"""How XLA compiles in the tests: its passes would take half of their time."""

import os

QUICK_XLA = "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false"

# Of one program, in a test that asks what XLA's passes make of it.
ALL_PASSES = {"xla_backend_optimization_level": 3}


def as_users_have_it() -> dict[str, str]:
    """The environment of a command that is compiled as users have it."""
    flags = os.environ.get("XLA_FLAGS", "").replace(QUICK_XLA, "").strip()
    return os.environ | {"XLA_FLAGS": flags}
