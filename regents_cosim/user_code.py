"""Modules that a user names: a planner, a policy, a network."""

import importlib
import importlib.util
from pathlib import Path
from types import ModuleType

from regents_cosim.errors import PlannerError


def import_named(module_name: str, what: str) -> ModuleType:
    """The module of that dotted name, or the Python file at that path. `what` it is wanted for stands in the error.

    Raises PlannerError with what the module itself raised.
    """
    try:
        if not module_name.endswith(".py"):
            return importlib.import_module(module_name)
        spec = importlib.util.spec_from_file_location(Path(module_name).stem, module_name)
        if spec is None or spec.loader is None:
            raise ImportError(f"{module_name} is not a Python file")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    except Exception as error:  # whatever a user's module raises is the user's answer
        raise PlannerError(f"{what} cannot be imported: {type(error).__name__}: {error}") from error
    return module
