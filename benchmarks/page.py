"""Seconds until the map page of ``sidestep serve`` is usable in Debian's Chromium.

    python benchmarks/page.py

The form takes input, and streets are drawn in the colours of their crowds. Times count from the first byte of the page.
The server is started anew, and has compiled its programs. The browser is new for each first visit, and keeps files for
the one that follows.
"""

import argparse
import json
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from urllib.request import urlopen

from playwright.sync_api import BrowserContext, sync_playwright

LINK = "#at=Sat-17:30"
ARGUMENTS = ["--no-sandbox", "--headless", "--enable-unsafe-swiftshader"]
WATCH = """
const noticed = (name, found) => {
  const look = () => (found() ? performance.mark(name) : requestAnimationFrame(look));
  look();
};
noticed("form", () => document.querySelector("#end-from") && document.querySelector("#slider").value === "1050");
noticed("coloured", () => {
  const map = globalThis.sidestep?.map;
  return document.documentElement?.dataset.map === "drawn" && map.areTilesLoaded() &&
    map.queryRenderedFeatures({ layers: ["streets"] }).some(({ state }) => state.crowd === 3);
});
"""
TIMES = """() => {
  const first = performance.getEntriesByType("navigation")[0].responseStart;
  const marks = ["form", "coloured"].flatMap((name) => performance.getEntriesByName(name));
  return marks.map(({ startTime }) => (startTime - first) / 1000);
}"""


def visit(context: BrowserContext, address: str) -> list[float]:
    """Seconds from the first byte until the form takes input, and until crowded streets are drawn as such."""
    page = context.new_page()
    page.goto(f"{address}/{LINK}")
    for _ in range(1200):
        if len(found := page.evaluate(TIMES)) == 2:
            page.close()
            return found
        page.wait_for_timeout(50)
    sys.exit("the page was not usable within a minute")


def main() -> None:
    """Print the median and the worst of some visits."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--visits", type=int, default=5)
    given = options.parse_args()
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder, "log")
        command = [sys.executable, "-m", "sidestep", "serve", "helsinki", "--port", "0", "--store", f"{folder}/s.db"]
        with log.open("w") as file:
            server = subprocess.Popen(command, stderr=file)
        while (found := re.search(r"http://[^/\s]+", log.read_text())) is None:
            assert server.poll() is None, log.read_text()
            time.sleep(0.1)
        while not _prepared(found[0]):
            time.sleep(0.2)
        rows: dict[str, list[list[float]]] = {"first visit": [], "again": []}
        with sync_playwright() as playwright:
            for _ in range(given.visits):
                browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
                context = browser.new_context(viewport={"width": 1440, "height": 900})
                context.add_init_script(WATCH)
                for times in rows.values():
                    times.append(visit(context, found[0]))
                browser.close()
        server.terminate()
        server.wait(20)
    for name, times in rows.items():
        for part, seconds in zip(("form takes input", "streets coloured"), zip(*times, strict=True), strict=True):
            middle, most = statistics.median(seconds), max(seconds)
            print(f"{name:12s} {part:18s} median {middle:5.2f} s  most {most:5.2f} s")


def _prepared(address: str) -> bool:
    try:
        with urlopen(f"{address}/readyz", timeout=5) as answer:  # noqa: S310 # it is this server's
            return bool(json.load(answer)["prepared"])
    except OSError:
        return False


if __name__ == "__main__":
    main()
