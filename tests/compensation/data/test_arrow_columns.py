"""Names that Parquet brings as numbers: the same as of the texts themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from armd.compensation.data.tables import pieces
from armd.compensation.data.tables.arrow_columns import FEW_NAMES, encode_in_order, to_codes
from armd.errors import BadInput


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (["a", "b"], [0, 1, 1, 0]),
        (["a", "b", "c"], [2, 2, 0]),  # another order, and one that is not there
        (["a", "b", "a"], [2, 1, 0]),  # one name under two numbers
        ([str(i) for i in range(FEW_NAMES + 1)], [FEW_NAMES, 0]),
        ([], []),
    ],
)
def test_numbers_follow_the_order_of_the_rows(names: list[str], numbers: list[int]) -> None:
    stored = pa.DictionaryArray.from_arrays(
        pa.array(numbers, pa.int32()), pa.array(names, pa.string())
    )
    expected = stored.cast(pa.string()).dictionary_encode()
    found = encode_in_order(stored)
    np.testing.assert_array_equal(to_codes(found), to_codes(expected))
    assert found.dictionary.to_pylist() == expected.dictionary.to_pylist()


def test_pieces_of_parquet_have_the_names_of_their_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pieces, "PIECE_ROWS", 3)
    path = tmp_path / "readings.parquet"
    texts = ["P2", "P2", "P1", "P1", "P1", "P2", "P3", None]
    pa.parquet.write_table(pa.table({"placement": texts}), path, row_group_size=7)
    read = list(pieces.read_pieces(path, [], ["placement"]))
    found = []
    for piece in read[:-1]:
        codes, names = piece.names("placement")
        assert names == list(dict.fromkeys(names[code] for code in codes))
        found += [names[code] for code in codes]
    assert found == texts[: len(found)]
    assert len(found) >= 6
    with pytest.raises(BadInput, match="row 8, column placement: found nothing"):
        read[-1].names("placement")
