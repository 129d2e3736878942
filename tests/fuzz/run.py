"""Damage what comes in at every door, for minutes, and keep what broke one: make fuzz MINUTES=10.

Each fault is printed once, by the place that raised it, with the file that does it again.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path
from types import FrameType

from fuzz.doors import Door, Fault, dme, page
from fuzz.files import file_doors
from fuzz.messages import message_doors
from fuzz.mutate import damage
from fuzz.network import network_doors
from fuzz.offline import offline_doors
from fuzz.recordings import recording_doors
from fuzz.wires import wire_doors

#: No input of a few kilobytes is worth more of a processor.
MOST_CPU_S = 60


class Slow(Exception):
    """The processor time of one input is used up."""


def all_doors(folder: Path) -> list[Door]:
    return [
        *file_doors(folder / "files"), page(folder / "page"), *dme(folder / "dme"),
        *message_doors(folder), *wire_doors(), *offline_doors(folder / "offline"),
        *network_doors(folder / "network"),
        *recording_doors(folder / "recordings"),
    ]  # fmt: skip


def enter(door: Door, data: bytes) -> str | None:
    """What went wrong, told by the place that raised it; None: the door held."""

    def stop(_: int, __: FrameType | None) -> None:
        raise Slow(f"over {MOST_CPU_S} s of processor time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, MOST_CPU_S)
    try:
        door.enter(data)
    except Fault as fault:
        return f"{door.name}: {fault}"
    except Exception as error:
        places = traceback.extract_tb(error.__traceback__)
        ours = [place for place in places if "/armd/" in place.filename] or places
        where = f"{Path(ours[-1].filename).name}, {ours[-1].name}"
        return f"{door.name}: {type(error).__name__} in {where}: {str(error)[:300]}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
    return None


def fuzz(
    doors: list[Door], seed: int, seconds: float, most: int | None, keep: Path
) -> Counter[str]:
    """Faults by their text: sound inputs, then damaged ones for *seconds*, *most* at most."""
    rng = random.Random(seed)
    faults: Counter[str] = Counter()
    entered: Counter[str] = Counter()
    spent: Counter[str] = Counter()
    for door in doors:  # sound input goes through
        for data in door.seeds:
            if (fault := enter(door, data)) is not None:
                faults[f"sound input: {fault}"] += 1
    n, end_s = 0, time.monotonic() + seconds
    while time.monotonic() < end_s and (most is None or n < most):
        n += 1
        # Without a number of inputs each door has as much time as another, so that cheap ones are
        # tried more often; with one they take turns, so that a seed gives the same inputs anywhere.
        door = doors[n % len(doors)] if most else min(doors, key=lambda door: spent[door.name])
        data = damage(rng.choice(door.seeds), rng)
        began_s = time.process_time()
        fault = enter(door, data)
        spent[door.name] += time.process_time() - began_s + 1e-4
        entered[door.name] += 1
        if fault is not None:
            kind = re.sub(r"[\d'\"].*?:|\d+", "", fault)[:120]
            faults[kind] += 1
            if faults[kind] == 1:
                keep.mkdir(parents=True, exist_ok=True)
                path = keep / f"{len(faults):03d}-{door.name.replace(' ', '-').replace('/', '-')}"
                path.write_bytes(data)
                print(f"{path}: {fault}", flush=True)
    print(f"armd: {n} inputs at {len(doors)} doors, {len(faults)} kinds of fault")
    for door in doors:
        print(f"  {entered[door.name]:8d}  {door.name}")
    for kind, times in faults.most_common():  # once more, where a log that was cut still has them
        print(f"armd: {times} times: {kind}")
    return faults


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--doors", nargs="*", default=[], metavar="WORD", help="in their names")
    parser.add_argument("--keep", type=Path, default=Path("out/fuzz"))
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_STATE_HOME"] = folder
        doors = all_doors(Path(folder))
        if args.doors:
            doors = [door for door in doors if any(word in door.name for word in args.doors)]
        faults = fuzz(doors, args.seed, 60 * args.minutes, None, args.keep)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
