import gc
import os
import signal
import sys

import checked_shapes  # noqa: F401
import hypothesis
import jax
import pytest
from quick_xla import QUICK_XLA

from regents_cosim.mirror.programs.compile_cache import keep_compiled_programs

# Most of the suite's time is compilation: both workers, the commands they start and the next run share it.
keep_compiled_programs()

# Commands and planners that tests start, hundreds of them, find the package's bytecode: a tenth of their start.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Each worker has a core: threads of OpenMP would wait for those of the other worker.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# A shell starts what runs behind it with interrupts ignored, and the commands that tests interrupt would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# With what JAX keeps, a twelfth of the suite's time went into looking for garbage.
gc.set_threshold(50_000)

# The machine that runs the tests is shared: an example may take long without being wrong.
# Fixtures of one test serve all its examples: the only ones with @given set a precision or a folder.
# New examples are for whoever changes something: a commit does not fail by chance.
hypothesis.settings.register_profile(
    "shared",
    deadline=None,
    derandomize="CI" in os.environ,
    suppress_health_check=[hypothesis.HealthCheck.function_scoped_fixture],
)
hypothesis.settings.load_profile("shared")


def pytest_configure(config):
    """Before JAX compiles the first program, and for the commands that tests start; `bench-parts` asks for speed."""
    config.option.benchmark_skip = not config.option.benchmark_only
    if not config.option.benchmark_only:
        os.environ["XLA_FLAGS"] = f"{QUICK_XLA} {os.environ.get('XLA_FLAGS', '')}".strip()


@pytest.fixture
def x64():
    """Double precision on the device, to compare gradients with finite differences."""
    with jax.enable_x64(True):
        yield
