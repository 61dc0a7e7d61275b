"""Find files in a suite that pytest would run: a suite is data, and may come from a stranger."""

import os
from pathlib import Path

# pytest imports the first two from every folder that it collects; the others can name plugins to import.
_RUN = ("conftest.py", "__init__.py")
_OBEYED = ("pytest.toml", ".pytest.toml", "pytest.ini", ".pytest.ini", "pyproject.toml", "tox.ini", "setup.cfg")


def code_for_pytest(suite: Path) -> list[str]:
    """Names of files in `suite` that pytest runs or obeys; none for a suite around the working directory."""
    if Path.cwd().resolve().is_relative_to(suite.resolve()):
        return []
    return _there(suite, (*_RUN, *_OBEYED))


def run_by_pytest(folder: Path) -> list[str]:
    """Names of files in `folder` that pytest runs when it collects from it."""
    return _there(folder, _RUN)


def _there(folder: Path, names: tuple[str, ...]) -> list[str]:
    return [name for name in names if os.path.lexists(folder / name)]
