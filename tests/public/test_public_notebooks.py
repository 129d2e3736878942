"""The notebooks of docs/notebooks run from empty folders, and hold what they promise."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "notebooks"
#: Appended to a notebook, in whose names they are checked.
CHECKS = {
    "own-arm": """
assert nominal.rms_um > 500 and calibrated.rms_um < 4.0 and verification.passed
assert set(parameters.columns) >= {"name", "unit", "nominal", "value", "standard_uncertainty"}
assert all(Path(name).stat().st_size for name in ("calibration.html", "verify.html"))
""",
    "hidden-cause": """
assert [(f.cause, f.location) for f in diagnosis.findings] == [("encoder_eccentricity", "joint 3")]
assert after.rms_um < before.rms_um - 0.3
assert worst.variable.iloc[0] == "q3" and worst.outside_before.iloc[0] > 0.5
assert worst.outside_after.iloc[0] < 0.2
""",
    "live-arm": """
assert count > 2000 and len(lines[0].get_xdata()) > 500
assert demo.returncode is not None
try:
    arm.latest()
    raise AssertionError
except armd.Closed:
    pass
""",
    "parquet-folder": """
whole = pl.read_parquet("corrected.parquet")
files = pl.concat(pl.read_parquet(file) for file in sorted(Path("corrected").glob("*.parquet")))
assert len(whole) == 160_000 and whole.equals(files)
by_command = corrector(pl.read_parquet("points/hour-0.parquet"))
assert pl.from_arrow(by_command).equals(whole.head(20_000))
""",
}


def test_notebooks_are_stored_without_outputs() -> None:
    assert {path.stem for path in NOTEBOOKS.glob("*.ipynb")} == set(CHECKS)
    for name in CHECKS:
        notebook = json.loads((NOTEBOOKS / f"{name}.ipynb").read_text(encoding="utf-8"))
        assert notebook["cells"][0]["source"][0].startswith("# ")
        code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
        assert code, name
        for cell in code:
            assert cell["outputs"] == [] and cell["execution_count"] is None, name


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", CHECKS)
def test_a_notebook_runs_from_an_empty_folder(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its outputs go to the folder that ARMD_NOTEBOOKS names, for the site of `make docs`."""
    client = pytest.importorskip("nbclient", reason="make notebooks installs it")
    nbformat = pytest.importorskip("nbformat")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    notebook = nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4)
    nbformat.validate(notebook)
    notebook.cells.append(nbformat.v4.new_code_cell(CHECKS[name]))
    place = {"metadata": {"path": str(tmp_path)}}
    client.NotebookClient(notebook, timeout=500, kernel_name="python3", resources=place).execute()
    del notebook.cells[-1]
    shown = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert (
        any("image/png" in output.get("data", {}) for output in shown) or name == "parquet-folder"
    )
    if "ARMD_NOTEBOOKS" in os.environ:
        target = Path(os.environ["ARMD_NOTEBOOKS"])
        target.mkdir(parents=True, exist_ok=True)
        nbformat.write(notebook, target / f"{name}.ipynb")
