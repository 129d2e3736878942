"""`make hidden-freeze SEED=…`: draw the frozen cases of every kind once, and check them.

The cases are written to .cache/hidden/SEED. checksums.json beside this file keeps the fingerprint
of each case of a seed, which another processor's last digits leave as it is; `--record` adds to a
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
from hidden.frozen.case import Fingerprint, Sums, fingerprint
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
) -> dict[str, Fingerprint]:
    """Draw the cases that *folder* lacks; return the fingerprint of each of *cases*."""
    missing = [(c, seed, folder / c.name) for c in cases if anew or not (folder / c.name).exists()]
    if missing:
        with multiprocessing.get_context("spawn").Pool(workers) as pool:
            for i, name in enumerate(pool.imap_unordered(_draw, missing), 1):
                print(f"\r{i} of {len(missing)} drawn, {name:20s}", end="", file=sys.stderr)
        print(file=sys.stderr)
    return {case.name: fingerprint(folder / case.name) for case in cases}


def _draw(task: tuple[Wanted, int, Path]) -> str:
    draw_case(*task)
    return task[0].name


def differing_from_record(seed: int, drawn: Mapping[str, Fingerprint]) -> list[str]:
    """The names of cases that are not as recorded; raises `SystemExit` for any not recorded."""
    known = read_recorded().get(str(seed), {})
    unknown = [name for name in drawn if name not in known]
    if unknown:
        sys.exit(
            f"armd: {CHECKSUMS.name}: found no record of {len(unknown)} of {len(drawn)} cases of "
            f"seed {seed} ({unknown[0]}), expected all; make hidden-freeze SEED={seed} RECORD=1"
        )
    return [name for name, one in drawn.items() if not known[name].agrees(one)]


def record(seed: int, drawn: Mapping[str, Fingerprint]) -> None:
    """Keep each case's fingerprint, beside those recorded before."""
    recorded = read_recorded()
    known = recorded.get(str(seed), {}) | drawn
    recorded[str(seed)] = {
        case.name: known[case.name] for case in wanted_cases() if case.name in known
    }
    lines = {
        seed: {name: _line(one) for name, one in sorted(cases.items())}
        for seed, cases in recorded.items()
    }
    each = {
        seed: ",\n".join(f"{json.dumps(name)}: {json.dumps(line)}" for name, line in cases.items())
        for seed, cases in lines.items()
    }
    text = "{\n" + ",\n".join(f'"{seed}": {{\n{cases}\n}}' for seed, cases in each.items()) + "\n}"
    CHECKSUMS.write_text(text + "\n", encoding="utf-8")


def _line(one: Fingerprint) -> list[str | list[float]]:
    return [one.text, *([sums.size, *sums.weighted] for sums in (one.read, one.judged))]


def read_recorded() -> dict[str, dict[str, Fingerprint]]:
    if not CHECKSUMS.exists():
        return {}
    return {
        seed: {
            name: Fingerprint(text, *(Sums(size, tuple(sums)) for size, *sums in both))
            for name, (text, *both) in cases.items()
        }
        for seed, cases in json.loads(CHECKSUMS.read_text(encoding="utf-8")).items()
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--kinds", default="*", help="patterns of kinds, separated by commas")
    parser.add_argument("--cases", type=int, help="of each kind at most")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument(
        "--record", action="store_true", help="keep the fingerprints of this drawing"
    )
    parser.add_argument("--anew", action="store_true", help="draw again what is there")
    args = parser.parse_args()
    cases = wanted_cases(args.kinds, args.cases)
    drawn = draw_missing(cases, args.seed, CACHE / str(args.seed), args.workers, args.anew)
    if args.record:
        record(args.seed, drawn)
    differing = differing_from_record(args.seed, drawn)
    if differing:
        few = ", ".join(differing[:5])
        print(f"armd: {len(differing)} of {len(cases)} cases differ from {CHECKSUMS.name}: {few}")
        print("The generators or the libraries have changed: record a new seed with RECORD=1.")
        return 1
    print(f"{len(cases)} cases, as recorded")
    return 0


if __name__ == "__main__":
    sys.exit(main())
