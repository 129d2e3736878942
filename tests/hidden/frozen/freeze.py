"""`make hidden-freeze SEED=…`: draw the frozen cases of every kind once, and check their digest.

The cases are written to .cache/hidden/SEED. checksums.json beside this file keeps, for each seed,
how many cases there are, their SHA-256 together and the first digits of each; `--record` adds to a
seed's entry or replaces it. A drawing that differs from its entry is an error: the generators have
changed, or the libraries.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import shutil
import sys
import tempfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
from hidden.frozen import other_kinds, outsider_kinds, simulated_kinds
from hidden.frozen.case import digest, digest_of_all
from hidden.frozen.from_simulator import write_case as write_simulated

ROOT = Path(__file__).parents[3]
CACHE = ROOT / ".cache" / "hidden"
CHECKSUMS = Path(__file__).with_name("checksums.json")
COUNTS = {
    kind: count
    for table in (simulated_kinds.KINDS, outsider_kinds.KINDS, other_kinds.KINDS)
    for kind, (_, count) in table.items()
}


@dataclass(frozen=True)
class Wanted:
    """One case: its kind, and its number within the kind."""

    kind: str
    number: int

    @property
    def name(self) -> str:
        return f"{self.kind}-{self.number:02d}"


def wanted_cases(kinds: str = "*", most: int | None = None) -> list[Wanted]:
    """The cases of the kinds that match one of the patterns, number 0 of each kind first."""
    chosen = [k for k in COUNTS if any(fnmatch(k, pattern) for pattern in kinds.split(","))]
    numbers = range(max((COUNTS[kind] for kind in chosen), default=0))
    return [
        Wanted(kind, number)
        for number in numbers[:most]
        for kind in chosen
        if number < COUNTS[kind]
    ]


def draw_case(wanted: Wanted, seed: int, folder: Path) -> None:
    """Write the case into *folder*, whole or not at all."""
    kind, number = wanted.kind, wanted.number
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode()), number])
    own = int(rng.integers(1 << 31))
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".drawing-") as made:
        place = Path(made) / wanted.name
        place.mkdir()
        if kind in simulated_kinds.KINDS:
            write_simulated(place, kind, own, simulated_kinds.KINDS[kind][0](rng, number))
        elif kind in outsider_kinds.KINDS:
            drawn = outsider_kinds.KINDS[kind][0](rng, number)
            outsider_kinds.write_case(place, kind, own, drawn)
        else:
            other_kinds.KINDS[kind][0](place, kind, own, rng, number)
        shutil.rmtree(folder, ignore_errors=True)
        place.rename(folder)


def draw_missing(
    cases: list[Wanted], seed: int, folder: Path, workers: int, anew: bool = False
) -> dict[str, str]:
    """Draw the cases that *folder* lacks; return the digest of each of *cases*."""
    missing = [(c, seed, folder / c.name) for c in cases if anew or not (folder / c.name).exists()]
    if missing:
        with multiprocessing.get_context("spawn").Pool(workers) as pool:
            for i, name in enumerate(pool.imap_unordered(_draw, missing), 1):
                print(f"\r{i} of {len(missing)} drawn, {name:20s}", end="", file=sys.stderr)
        print(file=sys.stderr)
    return {case.name: digest(folder / case.name) for case in cases}


def _draw(task: tuple[Wanted, int, Path]) -> str:
    draw_case(*task)
    return task[0].name


def check_digests(seed: int, digests: Mapping[str, str]) -> list[str]:
    """The names of cases that are not as recorded; raises `SystemExit` for a seed not recorded."""
    recorded = json.loads(CHECKSUMS.read_text(encoding="utf-8"))
    if str(seed) not in recorded:
        sys.exit(f"armd: seed {seed} is not recorded; make hidden-freeze SEED={seed} RECORD=1")
    known = recorded[str(seed)]["by_case"]
    return [name for name, value in digests.items() if known.get(name) != value[:16]]


def record(seed: int, digests: Mapping[str, str]) -> None:
    """Keep the first 16 digits of each case's digest, beside those recorded before."""
    recorded = json.loads(CHECKSUMS.read_text(encoding="utf-8")) if CHECKSUMS.exists() else {}
    known = recorded.get(str(seed), {"by_case": {}})["by_case"]
    known = known | {name: value[:16] for name, value in digests.items()}
    known = {case.name: known[case.name] for case in wanted_cases() if case.name in known}
    recorded[str(seed)] = {
        "cases": len(known),
        "sha256": digest_of_all(known),
        "by_case": dict(sorted(known.items())),
    }
    CHECKSUMS.write_text(json.dumps(recorded, indent=1) + "\n", encoding="utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--kinds", default="*", help="patterns of kinds, separated by commas")
    parser.add_argument("--cases", type=int, help="of each kind at most")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--record", action="store_true", help="keep the digests of this drawing")
    parser.add_argument("--anew", action="store_true", help="draw again what is there")
    args = parser.parse_args()
    cases = wanted_cases(args.kinds, args.cases)
    digests = draw_missing(cases, args.seed, CACHE / str(args.seed), args.workers, args.anew)
    if args.record:
        record(args.seed, digests)
    differing = check_digests(args.seed, digests)
    if differing:
        few = ", ".join(differing[:5])
        print(f"armd: {len(differing)} of {len(cases)} cases differ from {CHECKSUMS.name}: {few}")
        print("The generators or the libraries have changed: record a new seed with RECORD=1.")
        return 1
    short = {name: value[:16] for name, value in digests.items()}
    print(f"{len(cases)} cases, {digest_of_all(short)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
