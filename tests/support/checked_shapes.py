"""Importing it has the shapes of arrays checked at run time in all that is imported later.

But in scenario.py and cases/, which check them with words of their own, and in readers that take a file apart value by
value: they have few arrays, and a million checked calls took a third of the suite's time. Nor where speed is measured.
"""

import sys

from jaxtyping import install_import_hook

CHECKED = (
    "regents_cosim.attacks",
    "regents_cosim.benchmarks",
    "regents_cosim.collisions",
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

if "--benchmark-only" not in sys.argv:
    install_import_hook(CHECKED, "beartype.beartype")
