"""Pictures of the console for the documentation: ``make console-pictures RUN=runs/aeb-demo``.

Opens ``viewer web RUN`` in Chromium and takes the wall and the page of the worst case, as they
stand on the screen. RUN should be recorded, else there are no pictures to show.
"""

from __future__ import annotations

import io
import json
import signal
import subprocess
import sys
from pathlib import Path

from browser_pages import ARGUMENTS, CHROMIUM, PATIENCE_MS
from PIL import Image
from playwright.sync_api import Page, expect, sync_playwright

SCREEN = {"width": 1280, "height": 800}
QUALITY = 70
"""Of the WebP files."""


def main(run: Path, out: Path) -> None:
    """Write ``console-wall.webp`` and ``console-case.webp`` into ``out``."""
    command = [sys.executable, "-m", "viewer", "web", str(run), "--output", "json"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    try:
        url = json.loads(server.stdout.readline())["url"]
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=str(CHROMIUM), args=ARGUMENTS)
            page = browser.new_page(viewport=SCREEN, reduced_motion="reduce")
            page.set_default_timeout(PATIENCE_MS)
            expect.set_options(timeout=PATIENCE_MS)
            page.goto(url)
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
    finally:
        server.send_signal(signal.SIGINT)
        server.wait()


def shoot(page: Page, path: Path) -> None:
    """What stands on the screen, as a file."""
    Image.open(io.BytesIO(page.screenshot())).convert("RGB").save(path, quality=QUALITY, method=6)
    print(f"{path}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
