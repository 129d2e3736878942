"""Tables of results: named columns that pandas, polars, DuckDB and Arrow accept directly."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from armd.offline.results.display import MOST_LINES, shorten_end

#: Number of rows shown of a longer table.
SHOWN_ROWS = 12


class ArrowTable:
    """Columns of one length, by name; NaN in a column of numbers is missing.

    `table["name"]` is a numpy array (n,). The table has `__arrow_c_stream__` (the Arrow PyCapsule
    interface): `polars.DataFrame(table)`, `pyarrow.table(table)` and a query of DuckDB take it.
    Its iteration yields one dict a row, so that `pandas.DataFrame(table)` takes it, too.

    >>> table = ArrowTable({"name": ["a", "b"], "value": np.array([1.0, 2.0])})
    >>> table["value"].sum()
    np.float64(3.0)
    """

    def __init__(self, columns: Mapping[str, npt.ArrayLike | Sequence[str]]) -> None:
        self._columns: dict[str, npt.NDArray[Any]] = {
            name: np.asarray(values) for name, values in columns.items()
        }

    @property
    def column_names(self) -> list[str]:
        """Names of the columns, in order."""
        return list(self._columns)

    def __len__(self) -> int:
        return len(next(iter(self._columns.values()), ()))

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        return self._columns[name]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        columns = [column.tolist() for column in self._columns.values()]
        for row in zip(*columns, strict=True):
            yield dict(zip(self._columns, row, strict=True))

    def to_dict(self) -> dict[str, list[Any]]:
        """Return each column as a list, by name."""
        return {name: column.tolist() for name, column in self._columns.items()}

    def to_arrow(self) -> Any:
        """Return a `pyarrow.Table`; raises `ImportError` where pyarrow is not installed."""
        try:
            import pyarrow as pa
        except ModuleNotFoundError as error:
            raise ImportError("Arrow tables need pyarrow: pip install pyarrow") from error
        arrays = {
            name: pa.array(column.tolist() if column.dtype.kind in "UO" else column,
                           from_pandas=True)
            for name, column in self._columns.items()
        }  # fmt: skip
        return pa.table(arrays)

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self.to_arrow().__arrow_c_stream__(requested_schema)

    def _texts(self) -> list[list[str]]:
        rows = [self.column_names]
        for i in range(min(len(self), SHOWN_ROWS)):
            rows.append([_text(column[i]) for column in self._columns.values()])
        return rows

    def _rest(self) -> str:
        n_more_rows = len(self) - SHOWN_ROWS
        return f"… {n_more_rows} more rows" if n_more_rows > 0 else ""

    def __repr__(self) -> str:
        rows = self._texts()
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ]
        lines += filter(None, [self._rest()])
        return "\n".join(shorten_end(line) for line in lines[:MOST_LINES])

    def _repr_html_(self) -> str:
        head, *rows = [[html.escape(cell) for cell in row] for row in self._texts()]
        body = "".join(f"<tr><td>{'</td><td>'.join(row)}</td></tr>" for row in rows)
        titles = "</th><th>".join(head)
        return f"<table><tr><th>{titles}</th></tr>{body}</table><p>{self._rest()}</p>"


def _text(value: object) -> str:
    if isinstance(value, float | np.floating):
        return "" if np.isnan(value) else f"{value:.6g}"
    return str(value)
