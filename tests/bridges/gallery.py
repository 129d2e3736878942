"""The pictures of docs/tutorials/gallery/ and the page that shows them: `make gallery`.

    PYTHONPATH=tests python tests/bridges/gallery.py docs/tutorials

Everything is made here, by the commands under each picture; the page of `armd view` is a picture of
its own (`make picture`), the recording of the demo as well (`make recording`).
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from armd.files.writing import write_whole
from support.browser import find_browser

SIZE = {"width": 1100, "height": 1500}
CIRCLE = [sys.executable, str(Path(__file__).parents[1] / "scenarios" / "circle.py"), "--seed", "5"]
HEAD = """\
# Gallery

What armd shows, each picture with the commands that make it. `make gallery` makes this page and
its pictures anew, but the first two (`make picture`, `make recording`).

## The page of armd view

[view.md](../how-to/view.md): the arm of `armd demo`, warming up.

![The page of armd view](../view.png)

## make demo

![make demo](../demo.svg)
"""
CIRCLE_WORDS = """\

## The circle

`make circle`: an arm goes wrong; a simulated operator measures it over the wire; it is diagnosed,
mended and verified; its twin errs as it did.

```
{said}
```
"""


@dataclass(frozen=True)
class Shown:
    """One report: its file, what it is, and the commands that make it."""

    name: str
    title: str
    words: str
    commands: tuple[str, ...]


REPORTS = (
    Shown(
        "calibrate",
        "The report of a calibration",
        "[calibrate.md](../how-to/calibrate.md): five temperatures, a simulated arm of 1.2 m.",
        (
            "armd simulate --session calibration -o measured",
            "armd calibrate measured/T* --arm measured/arm.toml -o cal.json"
            " --report calibrate.html",
        ),
    ),
    Shown(
        "verify",
        "A verification",
        "[verify.md](../how-to/verify.md): by ISO 10360-12 and ASME B89.4.22.",
        (
            "armd simulate --session verify -o test",
            "armd verify test/verify --arm measured/arm.toml --calibration cal.json"
            " --report verify.html",
        ),
    ),
    Shown(
        "diagnose",
        "A diagnosis",
        "[diagnosis.md](../how-to/diagnosis.md): a disc 1.5 µm off centre, of which the command is"
        " not told.",
        (
            "armd simulate --session diagnosis -o sick --plant 'encoder_eccentricity@joint 3=1.5'",
            "armd diagnose sick/session-* --arm sick/arm.toml --extended extended.json"
            " --report diagnose.html",
        ),
    ),
    Shown(
        "interim",
        "Interim checks",
        "[interim.md](../how-to/interim.md): an encoder slips on the twelfth of twenty days.",
        (
            "armd simulate --session interim -o days --days 20"
            " --plant 'encoder_slip@joint 3=15@12'",
            "armd interim add days/day-* --arm days/arm.toml --calibration cal.json"
            " --history history",
            "armd interim report --history history --report interim.html",
        ),
    ),
    Shown(
        "repeatability",
        "Repeatability and drift of a printed arm",
        "[measure.md](../how-to/measure.md): one place, visited sixty times in eight hours; 0.3 mm"
        " scatter, a drift with the motors' heat. The points are drawn, not measured.",
        ("armd feature repeatability visits.csv --report repeatability.html",),
    ),
)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("docs", type=Path, metavar="DOCS")
    docs = parser.parse_args().docs
    found = find_browser()
    if found is None:
        print("found no browser, expected one: make browser", file=sys.stderr)
        return 2
    pictures = docs / "gallery"
    pictures.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name, sync_playwright() as driver:
        folder = Path(name)
        draw_visits(folder / "visits.csv")
        browser = driver.chromium.launch(executable_path=found, args=["--no-sandbox"])
        page = browser.new_page(viewport=SIZE, color_scheme="light")
        for shown in REPORTS:
            for command in shown.commands:
                run(command, folder)
            page.goto((folder / f"{shown.name}.html").as_uri())
            photograph(page, pictures / f"{shown.name}.png")
            print(f"armd: {pictures / shown.name}.png", flush=True)
        browser.close()
    circle = subprocess.run(CIRCLE, capture_output=True, text=True, check=True).stdout
    write_whole(docs / "gallery.md", page_of(circle))
    return 0


def page_of(circle: str) -> str:
    """The page, with what `make circle` printed."""
    parts = [HEAD]
    for shown in REPORTS:
        parts.append(f"\n## {shown.title}\n\n{shown.words}\n")
        parts.append(f"\n```sh\n{chr(10).join(shown.commands)}\n```\n")
        parts.append(f"\n![{shown.title}](gallery/{shown.name}.png)\n")
    parts.append(CIRCLE_WORDS.format(said=re.sub(r"[ \t]+$", "", circle, flags=re.M).strip()))
    return "".join(parts)


def run(command: str, folder: Path) -> None:
    """As typed in *folder*; the shell's stars too, in the order of their numbers."""
    words: list[str] = []
    for word in shlex.split(command):
        found = folder.glob(word) if "*" in word else ()
        names = [str(path.relative_to(folder)) for path in found]
        words += sorted(names, key=numbers) or [word]
    line = [sys.executable, "-m", "armd", *words[1:]]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(line, cwd=folder, env=environment, capture_output=True, text=True)
    if done.returncode not in (0, 1):  # 1: the answer is no
        raise SystemExit(f"{command}\n{done.stdout}{done.stderr}")


def numbers(name: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", name)]


def photograph(page: Page, picture: Path) -> None:
    """The first screen of a report."""
    page.wait_for_load_state("networkidle")
    page.screenshot(path=picture)


def draw_visits(table: Path) -> None:
    """Eight hours of a printed arm in one seat: a drift with the motors' heat, and scatter."""
    rng = np.random.default_rng(1)
    hours = np.linspace(0.0, 8.0, 60)
    warm = 1.0 - np.exp(-hours / 1.5)
    drift = np.outer(warm, [0.9, -0.4, -1.6])
    position = np.array([220.0, 40.0, 120.0]) + drift + rng.normal(scale=0.17, size=(60, 3))
    rows = [
        f"{3600 * h:.0f},{x:.4f},{y:.4f},{z:.4f}"
        for h, (x, y, z) in zip(hours, position, strict=True)
    ]
    table.write_text("\n".join(["time_s,x_mm,y_mm,z_mm", *rows]) + "\n")


if __name__ == "__main__":
    sys.exit(main())
