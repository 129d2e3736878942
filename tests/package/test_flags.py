"""A flag is one row of `armd.Flag`: every page and example says what the row says."""

from __future__ import annotations

import itertools
import re

from armd import Flag
from support.pages import DOCS, page_path


def text(name: str) -> str:
    return page_path(name).read_text(encoding="utf-8")


def test_only_a_warning_lowers_the_quality() -> None:
    assert all(0 <= flag.quality <= 100 for flag in Flag)
    assert {flag.name for flag in Flag if flag.severity == "info" and flag.quality} == set()


def test_the_subscribers_page_lists_them() -> None:
    section = text("subscriber").split("\n## Flags\n")[1].split("\n## ")[0]
    expected = [f"- {flag.bit} {flag.name}: {flag.meaning}" for flag in Flag]
    assert section.strip().splitlines() == expected


def test_the_page_of_ippdme_has_the_quality_of_each() -> None:
    (listed,) = re.findall(r"by the worst \[flag\]\([^)]*\): (.*)", text("ippdme"))
    by_quality = itertools.groupby(
        sorted((flag for flag in Flag if flag.quality), key=lambda flag: (-flag.quality, flag.bit)),
        key=lambda flag: flag.quality,
    )
    expected = "; ".join(
        f"{quality} {', '.join(flag.title.lower() for flag in flags)}"
        for quality, flags in by_quality
    )
    assert listed == expected


def test_the_example_in_c_sharp_has_the_bits_it_uses() -> None:
    source = (DOCS / "examples" / "subscriber.cs").read_text(encoding="utf-8")
    found = re.findall(r"\b(\w+) = 1u? << (\d+)", source)
    names = {(flag.name or "").title().replace("_", ""): flag.bit for flag in Flag}
    assert found
    assert all(names[name] == int(bit) for name, bit in found)
