"""The gallery as a folder: pictures, the page that shows them, and the cases behind them."""

from pathlib import Path

import jax
import numpy as np

from benchmarks.gallery.exhibits import exhibits, run
from benchmarks.gallery.field_picture import draw_fields
from benchmarks.gallery.gradient_field import YAWS_DEG, gradient_field
from benchmarks.gallery.index import FIELD_PICTURE, index_page, picture_name
from benchmarks.gallery.panels import draw_exhibit
from regents_cosim.checks.names import inside
from regents_cosim.reports.drawing.canvas import Canvas, png_bytes
from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.files.output_files import require_ours, write_output_file


def make_gallery(folder: Path) -> list[Scenario]:
    """Write the gallery into `folder`; returns the attacked scenes, which are its cases.

    Raises RegentsError where `folder` cannot be written.
    """
    page = folder / "README.md"
    require_ours(page)
    cases = SuiteWriter(inside(folder, "cases"), seed=0)
    with jax.default_device(jax.local_devices(backend="cpu")[0]):  # everywhere the same numbers
        fields = [gradient_field(np.deg2rad(degrees)) for degrees in YAWS_DEG]
        runs = [run(exhibit) for exhibit in exhibits()]
    attacked = [scenario for made in runs for scenario in made.attacked.values()]
    for scenario in attacked:
        cases.add(scenario)
    _save(draw_fields(fields), folder / FIELD_PICTURE)
    for made in runs:
        _save(draw_exhibit(made), folder / picture_name(made))
    write_output_file(page, index_page(fields, runs).encode())
    return attacked


def _save(picture: Canvas, path: Path) -> None:
    write_output_file(path, png_bytes(picture.finish(), optimize=True))
