"""The picture of the page in README and docs: the arm of `armd demo`, calibrated and warming up.

    PYTHONPATH=tests python tests/bridges/picture.py out/view.png

On a machine that does nothing else: a picture that shows lost points is refused, with exit code 1.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from armd.daemon.commands.service.stage import SERIAL, Stage
from support.browser import find_browser
from support.running_bridge import running_bridge

SIZE = {"width": 1280, "height": 800}
WARM_UP_K, WARM_UP_S = 10.0, 150.0
#: Until there are some measurements and some slope in the curves.
PATIENCE_MS = 120_000
BROWSER = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
#: Measured often enough, and at rest: the tip's figures are readable.
READY = """() => document.querySelectorAll("#rows tr").length >= 15
  && document.querySelector("#flags [data-flag=AT_REST]")"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path, metavar="OUT.png")
    output = parser.parse_args().output
    found = find_browser()
    if found is None:
        print("found no browser, expected one: make browser", file=sys.stderr)
        return 2
    output.parent.mkdir(parents=True, exist_ok=True)
    with Stage(SERIAL, seed=1, warm_up_k=WARM_UP_K, warm_up_s=WARM_UP_S) as stage:
        stage.calibrate()
        stage.start()
        options = ("--endpoint", stage.endpoint, "--listen", "127.0.0.1:0")
        with running_bridge("view", *options) as view, sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=found, args=BROWSER)
            page = browser.new_page(viewport=SIZE, color_scheme="dark")
            page.goto(f"http://{view.where}/")
            page.wait_for_function(READY, timeout=PATIENCE_MS)
            lost = _lost(page)
            page.screenshot(path=output)
            browser.close()
    print(f"{output}: {lost} points lost")
    return 1 if lost else 0


def _lost(page: Page) -> int:
    told = re.search(r"(\d+) lost", page.inner_text("#rate"))
    assert told is not None, page.inner_text("#rate")
    return int(told[1])


if __name__ == "__main__":
    sys.exit(main())
