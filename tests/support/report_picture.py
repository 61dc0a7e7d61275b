"""Draws scenarios/report.png, the picture of the README: a case in the report, as Chromium shows it.

python tests/support/report_picture.py scenarios/standard CASE SECONDS scenarios/report.png
"""

import io
import shutil
import sys
import tempfile
from pathlib import Path
from urllib.parse import urlencode

from PIL import Image
from playwright.sync_api import sync_playwright

from regents_cosim import report

SIZE = {"width": 1360, "height": 820}


def shoot(page: Path, case: str, seconds: str) -> Image.Image:
    """A case of the report at a time."""
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        tab = browser.new_page(viewport=SIZE, device_scale_factor=1.5)
        tab.goto(f"{page.as_uri()}#{urlencode({'case': case, 't': seconds})}")
        tab.wait_for_selector("#case:not([hidden])")
        tab.evaluate("document.activeElement.blur()")  # no ring around what the keys move
        tab.wait_for_timeout(500)
        image = Image.open(io.BytesIO(tab.screenshot()))
        browser.close()
    return image


if __name__ == "__main__":
    suite, case, seconds, target = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "report.html"
        report(suite, page)
        shoot(page, case, seconds).convert("RGB").save(target, optimize=True)
