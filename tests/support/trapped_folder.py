"""A working directory as a stranger could send it: every name that Python or a package may look for runs something."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import packages_distributions
from pathlib import Path

_OTHERS = ("sitecustomize", "usercustomize", "conftest_", "jax_plugins", "regents_cosim", "tests")


@contextmanager
def trapped_folder(folder: Path) -> Iterator[Path]:
    """`folder` full of modules and packages of all names there are. Nothing of it may have run when the block ends."""
    trace = folder.parent / f"{folder.name}.RAN"
    folder.mkdir(parents=True, exist_ok=True)
    harm = f"with open({str(trace)!r}, 'a') as file:\n    file.write(__name__ + ' ')\nraise SystemExit(99)\n"
    for name in sys.stdlib_module_names:
        (folder / f"{name}.py").write_text(harm)
    for name in {*packages_distributions(), *_OTHERS}:
        if name.isidentifier() and not (folder / f"{name}.py").exists():
            (folder / name).mkdir()
            (folder / name / "__init__.py").write_text(harm)
    yield folder
    assert not trace.exists(), f"ran: {trace.read_text()}"
