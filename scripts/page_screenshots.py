"""Draw the pictures of the map page in docs/images with Chromium: ``python scripts/page_screenshots.py``.

It starts ``sidestep serve helsinki`` and stops it in the end. Fonts are those of the system.
"""

import re
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

IMAGES = Path(__file__).parents[1] / "docs" / "images"
ROUTE = "#from=24.941400,60.171900&to=24.948000,60.165500&at=Sat-17:30"
DESKTOP, PHONE = {"width": 1440, "height": 900}, {"width": 390, "height": 844}
ARGUMENTS = ["--no-sandbox", "--headless", "--enable-unsafe-swiftshader"]


def routes(page: Page) -> None:
    """Wait for other ways, which come last."""
    page.get_by_text("Another way").first.wait_for()
    page.locator("#routes-body").get_by_text("9 in 10").nth(3).wait_for()


def leave(page: Page) -> None:
    """Wait for the curve."""
    page.locator(".curve").wait_for()


def reach(page: Page) -> None:
    """Wait for the areas."""
    page.locator("#reach-found tbody tr").nth(2).wait_for(state="attached")


def walk(page: Page) -> None:
    """Walk some crossings, then meet a crowd until the plan changes."""
    page.select_option("#walk-speed", "60")
    page.click("#walk-start")
    page.locator("#walk-log li").nth(4).wait_for()
    for _ in range(8):
        page.click("#walk-crowd")
        page.locator("#walk-crowd[aria-pressed=false]").wait_for()
        if page.locator("#walk-log .changed").count():
            break
    page.click("#walk-pause")


def nothing(page: Page) -> None:
    """Wait for nothing more than the map."""
    page.locator("#day-shape rect").nth(23).wait_for(state="attached")


SHOTS = {
    "page-desktop": (DESKTOP, "light", ROUTE, routes),
    "page-dark": (DESKTOP, "dark", f"{ROUTE}&tab=leave", leave),
    "page-reach": (PHONE, "light", f"{ROUTE}&tab=reach", reach),
    "page-walk": (DESKTOP, "light", f"{ROUTE}&tab=walk", walk),
    "page-phone": (PHONE, "light", ROUTE, routes),
    "page-phone-dark": (PHONE, "dark", f"{ROUTE}&tab=leave", leave),
}


def answers(address: str) -> bool:
    """Whether the town is loaded."""
    try:
        with urllib.request.urlopen(f"{address}/readyz", timeout=10) as answer:  # noqa: S310 # it is this server's
            return bool(answer.status == 200)
    except OSError:
        return False


def main() -> None:
    """Draw all of them, or those that are named."""
    named = sys.argv[1:] or list(SHOTS)
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder, "log")
        command = [
            sys.executable,
            "-m",
            "sidestep",
            "serve",
            "helsinki",
            "--port",
            "0",
            "--store",
            f"{folder}/store.db",
        ]
        with log.open("w") as file:
            server = subprocess.Popen(command, stderr=file)
        while (found := re.search(r"http://[^/\s]+", log.read_text())) is None or not answers(found[0]):
            if server.poll() is not None:
                sys.exit(log.read_text())
            time.sleep(0.2)
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
            for name in named:
                size, scheme, link, ready = SHOTS[name]
                context = browser.new_context(viewport=size, color_scheme=scheme, device_scale_factor=1)
                page = context.new_page()
                page.set_default_timeout(120_000)
                page.goto(f"{found[0]}/{link}")
                page.wait_for_selector("html[data-map=drawn]")
                if name == "page-phone-dark":
                    page.click("#tab-leave")  # which pulls the sheet up
                ready(page)
                nothing(page)
                page.wait_for_timeout(1500)
                picture = Image.open(BytesIO(page.screenshot())).convert("RGB")
                # A quarter of the bytes, and nobody sees the difference.
                picture.quantize(256, dither=Image.Dither.NONE).save(IMAGES / f"{name}.png", optimize=True)
                print(IMAGES / f"{name}.png")
                context.close()
            browser.close()
        server.terminate()
        server.wait()


if __name__ == "__main__":
    main()
