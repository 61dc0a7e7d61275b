"""Find a user's method of attack by its name: an entry point, `package.module:Class` or `path/to/file.py:Class`."""

from importlib.metadata import entry_points
from typing import Any

from regents_cosim.attacks.methods.presets import METHODS, AttackConfig
from regents_cosim.checks.suggestions import did_you_mean
from regents_cosim.errors import RegentsError
from regents_cosim.system.user_code import import_named

GROUP = "regents_cosim.methods"


def own_method(name: str) -> AttackConfig:
    """The method with its default settings. Raises RegentsError where there is none of that name."""
    installed = {point.name: point.value for point in entry_points(group=GROUP)}
    module_name, _, attribute = installed.get(name, name).rpartition(":")
    if not module_name:
        raise RegentsError(f"method {name!r} is not known: {did_you_mean(name, [*METHODS, *installed])}")
    module = import_named(module_name, f"method {name!r}", installed=name in installed)
    found: Any = getattr(module, attribute, None)
    made: Any = found() if isinstance(found, type) else found
    if not isinstance(made, AttackConfig):
        raise RegentsError(f"method {name!r}: {module_name} has no {attribute!r} that is an AttackConfig")
    return made
