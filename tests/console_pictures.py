"""Pictures of the console for the documentation: ``make console-pictures RUN=runs/recorded``.

Writes the console of RUN as files, opens them in Chromium, and takes the wall and the page of the
worst case as they stand on the screen. RUN was recorded, else there are no pictures to show.

Those in docs/images are of the campaign beside this file, ten of whose twenty cases collide (three
minutes on two cores)::

    conductor run tests/console_pictures.yaml --view record --out runs/latency-limits
    make console-pictures RUN=runs/latency-limits
"""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
from pathlib import Path

from browser_pages import ARGUMENTS, CHROMIUM, PATIENCE_MS
from PIL import Image
from playwright.sync_api import Page, expect, sync_playwright

SCREEN = {"width": 1280, "height": 800}
QUALITY = 70
"""Of the WebP files."""


def main(run: Path, out: Path) -> None:
    """Write ``console-wall.webp`` and ``console-case.webp`` into ``out``."""
    with (
        tempfile.TemporaryDirectory(prefix="console-pictures-") as folder,
        sync_playwright() as driver,
    ):
        site = Path(folder) / "site"
        web = [sys.executable, "-m", "viewer", "web", str(run), "--static", str(site)]
        subprocess.run(web, check=True)
        browser = driver.chromium.launch(executable_path=str(CHROMIUM), args=ARGUMENTS)
        page = browser.new_page(viewport=SCREEN, reduced_motion="reduce")
        page.set_default_timeout(PATIENCE_MS)
        expect.set_options(timeout=PATIENCE_MS)
        page.goto((site / "index.html").as_uri())
        page.get_by_role("link", name="Open the wall").click()
        frame = page.locator(".frame")
        expect(frame.locator("canvas")).not_to_have_attribute("data-tiles", "0")
        expect(frame).to_have_attribute("data-loading", "0")
        shoot(page, out / "console-wall.webp")
        page.get_by_role("link", name="Summary").click()
        page.get_by_role("link", name="See why, and repeat it").click()
        expect(page.locator(".film canvas")).not_to_have_attribute("data-frame", "")
        expect(page.locator(".plot .main-svg").first).to_be_attached()
        shoot(page, out / "console-case.webp")
        browser.close()


def shoot(page: Page, path: Path) -> None:
    """What stands on the screen, as a file."""
    Image.open(io.BytesIO(page.screenshot())).convert("RGB").save(path, quality=QUALITY, method=6)
    print(f"{path}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
