"""The paper's experiment reaches its mark at every temperature."""

from __future__ import annotations

from pathlib import Path

import paper


def test_ten_micrometres_at_every_temperature(tmp_path: Path) -> None:
    found = paper.run(tmp_path)
    assert list(found) == list(paper.TEMPERATURES_C)
    assert paper.missed(found) == []
