"""A recording of `armd demo` as an animated SVG: `make recording` writes docs/demo.svg.

The read-out is the demo's own screen, a frame a second; CSS shows them one after another.
"""

from __future__ import annotations

import argparse
import io
import re
from pathlib import Path

from rich.console import Console, RenderableType
from rich.text import Text

import armd
from armd import keys
from armd.daemon.commands.screen import WIDTH, Screen, generate_refreshes
from armd.daemon.commands.service.comparison import compare, load_truth
from armd.daemon.commands.service.demo import REFRESH_S, WARM_UP_K, WARM_UP_S, Meter, format_summary
from armd.daemon.commands.service.stage import SERIAL, Stage
from armd.files.writing import write_whole

FRAME_S = 1.0
#: How many frames long the result is shown.
RESULT_FRAMES = 6
LINE_PX, CHARACTER_PX, MARGIN_PX = 24.4, 12.2, 20
MOST_LINES = 18
#: rich's drawing of text, without its window and its font from the network.
TEXT = "<style>{styles}</style>{backgrounds}{matrix}"
FRAME = '<g class="frame" style="animation-delay: {at:g}s">{text}</g>\n'
WHOLE = """\
<svg class="demo" viewBox="0 0 {width:g} {height:g}" xmlns="http://www.w3.org/2000/svg">
<title>armd demo: a simulated arm warms up, and its points are corrected</title>
<style>
.demo {{ font-family: "DejaVu Sans Mono", Menlo, Consolas, monospace; font-size: 20px; }}
.frame {{ visibility: hidden; animation: {total:g}s step-end infinite; }}
.frame {{ animation-name: frame; }}
.frame:last-of-type {{ animation-name: result; }}
@keyframes frame {{ 0% {{ visibility: visible; }} {frame:.3f}% {{ visibility: hidden; }} }}
@keyframes result {{ 0% {{ visibility: visible; }} {result:.3f}% {{ visibility: hidden; }} }}
</style>
<rect width="100%" height="100%" rx="8" fill="#292929"/>
<g transform="translate({margin}, {margin})">
{frames}</g>
</svg>
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path, metavar="OUT.svg")
    parser.add_argument("--seconds", type=int, default=20)
    args = parser.parse_args()
    write_whole(args.output, animate(*record(args.seconds)))
    return 0


def record(seconds: float) -> tuple[list[RenderableType], Text]:
    """What the demo shows each second, and its summary at the end."""
    meter, frames = Meter(), list[RenderableType]()
    with Stage(SERIAL, 1, WARM_UP_K, WARM_UP_S) as stage:
        stage.calibrate()
        stage.start()
        with (
            armd.connect(endpoint=stage.endpoint) as arm,
            Screen(arm, Console(quiet=True)) as screen,
            arm.calling(keys.POINT, meter.take),
        ):
            shown_s = 0.0
            for elapsed_s in generate_refreshes(seconds, REFRESH_S):
                screen.show(meter.collect(arm), elapsed_s)
                shown_s += elapsed_s
                if shown_s >= FRAME_S * (len(frames) + 1):
                    frames.append(screen.panel)
            meter.collect(arm)
        stage.stop()
        errors = compare(meter.sampled_points, load_truth(stage.truth))
        return frames, Text(format_summary(meter, arm.lost, errors, calibrated=True))


def animate(frames: list[RenderableType], result: Text) -> str:
    """All of them as one SVG, the result longest, and again from the start."""
    total_s = FRAME_S * (len(frames) + RESULT_FRAMES)
    drawn = [
        FRAME.format(at=FRAME_S * number, text=draw(frame, number))
        for number, frame in enumerate([*frames, result])
    ]
    return WHOLE.format(
        width=WIDTH * CHARACTER_PX + 2 * MARGIN_PX,
        height=MOST_LINES * LINE_PX + 2 * MARGIN_PX,
        margin=MARGIN_PX,
        total=total_s,
        frame=100 * FRAME_S / total_s,
        result=100 * FRAME_S * RESULT_FRAMES / total_s,
        frames="".join(drawn),
    )


def draw(frame: RenderableType, number: int) -> str:
    """One frame's text as SVG."""
    console = Console(record=True, width=WIDTH, file=io.StringIO(), force_terminal=True)
    console.print(frame, highlight=False)
    drawn = console.export_svg(code_format=TEXT, unique_id=f"f{number}")
    return re.sub(r' clip-path="[^"]*"', "", drawn)


if __name__ == "__main__":
    raise SystemExit(main())
