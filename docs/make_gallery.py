"""Draw the pictures of `docs/gallery.md` from the shipped cases that it names: `python docs/make_gallery.py`."""

import io
import re
from pathlib import Path

from PIL import Image

from regents_cosim.cases.files import load_case
from regents_cosim.cases.shipped import shipped
from regents_cosim.reports.picture import still

DOCS = Path(__file__).resolve().parent
WIDTH_PX, COLOURS = 800, 256


def shown() -> list[tuple[Path, Path]]:
    """The picture and the case of each entry of the page, in its order."""
    page = (DOCS / "gallery.md").read_text()
    found = re.findall(r"^!\[[^\]]*\]\((gallery/[\w-]+\.png)\)$.*?shipped:(\S+)", page, re.DOTALL | re.MULTILINE)
    return [(DOCS / picture, shipped("scenarios") / case) for picture, case in found]


def draw(case: Path) -> bytes:
    """A case's still as a small PNG of few colours."""
    picture = Image.open(io.BytesIO(still(load_case(case)))).convert("RGB")
    height = round(picture.height * WIDTH_PX / picture.width)
    small = picture.resize((WIDTH_PX, height), Image.Resampling.LANCZOS)
    small = small.quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    written = io.BytesIO()
    small.save(written, "PNG", optimize=True)
    return written.getvalue()


if __name__ == "__main__":
    for picture, case in shown():
        picture.write_bytes(draw(case))
        print(f"{picture.name}: {picture.stat().st_size / 1024:.0f} KiB")
