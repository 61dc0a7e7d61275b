"""What a suite must not hold, for pytest would run it: a suite is data, and may be a stranger's."""

from pathlib import Path

# pytest imports the first two from every folder that it collects from; what the others say names plugins to import.
_RUN = ("conftest.py", "__init__.py")
_OBEYED = ("pytest.toml", ".pytest.toml", "pytest.ini", ".pytest.ini", "pyproject.toml", "tox.ini", "setup.cfg")


def code_for_pytest(suite: Path) -> list[str]:
    """Names of files in `suite` that pytest runs or obeys; none where we work in the suite's folder, which is ours."""
    if Path.cwd().resolve().is_relative_to(suite.resolve()):
        return []
    return [name for name in (*_RUN, *_OBEYED) if (suite / name).exists() or (suite / name).is_symlink()]
