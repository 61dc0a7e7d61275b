"""Importing it has the shapes of arrays checked at run time in all that is imported later.

But in scenario.py and cases/, which check them with words of their own, and in readers that take a file apart value by
value: they have few arrays, and a million checked calls took a third of the suite's time. Nor where speed is measured.
Functions that say nothing of an array are left as they are: the type checker has read them, and their calls are many.
"""

import sys
from functools import partial
from typing import Any, get_args

import jaxtyping
from jaxtyping import install_import_hook

CHECKED = (
    "regents_cosim.attacks",
    "regents_cosim.benchmarks",
    "regents_cosim.scenario.collisions",
    "regents_cosim.evaluation",
    "regents_cosim.exports",
    "regents_cosim.geometry",
    "regents_cosim.maps",
    "regents_cosim.mirror",
    "regents_cosim.planners",
    "regents_cosim.replays",
    "regents_cosim.reports",
    "regents_cosim.routes",
    "regents_cosim.simulators.highway.net",
    "regents_cosim.training",
    "regents_cosim.sources.logs.roads.argoverse2_map",
    "regents_cosim.sources.logs.readers.argoverse2",
    "regents_cosim.sources.logs.files.csv_columns",
    "regents_cosim.sources.logs.cut",
    "regents_cosim.sources.logs.roads.edges",
    "regents_cosim.sources.logs.readers.gpudrive",
    "regents_cosim.sources.logs.inspection",
    "regents_cosim.sources.logs.readers.interaction",
    "regents_cosim.sources.logs.roads.lanelet2",
    "regents_cosim.sources.logs.planned_ego",
    "regents_cosim.sources.logs.files.polars_files",
    "regents_cosim.sources.logs.resample",
    "regents_cosim.sources.logs.roads.road",
    "regents_cosim.sources.logs.rows",
    "regents_cosim.sources.logs.readers.scenarionet",
    "regents_cosim.sources.logs.scene",
    "regents_cosim.sources.logs.readers.waymo_example",
    "regents_cosim.sources.windows",
    "regents_cosim.sources.recording",
    "regents_cosim.verdicts",
)

_checked = jaxtyping.jaxtyped


def of_arrays(function: Any = None, **how: Any) -> Any:
    """`jaxtyping.jaxtyped` for classes, and for functions whose annotations name the shape of an array."""
    if function is None:
        return partial(of_arrays, **how)
    inside = getattr(function, "fget", None) or getattr(function, "__func__", function)
    if isinstance(function, type) or any(map(names_a_shape, getattr(inside, "__annotations__", {}).values())):
        return _checked(function, **how)
    return function


def names_a_shape(annotation: Any) -> bool:
    """Whether an annotation is a type of arrays, holds one, or is a string, which may be one."""
    ours = type(annotation).__module__.partition(".")[0] == "jaxtyping" or isinstance(annotation, str)
    return ours or any(map(names_a_shape, get_args(annotation)))


if "--benchmark-only" not in sys.argv:
    jaxtyping.jaxtyped = of_arrays  # the import hook names it so in what it compiles
    install_import_hook(CHECKED, "beartype.beartype")
