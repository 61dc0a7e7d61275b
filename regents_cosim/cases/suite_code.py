"""What a suite must not hold, for pytest would run it: a suite is data, and may be a stranger's."""

import os
from pathlib import Path

# pytest imports the first two from every folder that it collects from; what the others say names plugins to import.
_RUN = ("conftest.py", "__init__.py")
_OBEYED = ("pytest.toml", ".pytest.toml", "pytest.ini", ".pytest.ini", "pyproject.toml", "tox.ini", "setup.cfg")


def code_for_pytest(suite: Path) -> list[str]:
    """Names of files in `suite` that pytest runs or obeys; none where we work in the suite's folder, which is ours."""
    if Path.cwd().resolve().is_relative_to(suite.resolve()):
        return []
    return _there(suite, (*_RUN, *_OBEYED))


def run_by_pytest(folder: Path) -> list[str]:
    """Names of files in `folder` that pytest runs when it goes through it."""
    return _there(folder, _RUN)


def _there(folder: Path, names: tuple[str, ...]) -> list[str]:
    return [name for name in names if os.path.lexists(folder / name)]
