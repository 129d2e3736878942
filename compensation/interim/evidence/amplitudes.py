"""Amplitudes of unit prior variance times a size, integrated out for many grams at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.arrays import F64

#: Entries (i, j), i ≥ j, of symmetric p × p matrices, each an array of its own, and p sides.
Lower = dict[tuple[int, int], F64]


def integrate_amplitudes(
    gram: Lower, side: Sequence[F64], sizes: Sequence[float]
) -> tuple[F64, F64]:
    """log det(I + s² G) and s² yᵀ (I + s² G)⁻¹ y for each of *sizes* s, along a new last axis.

    Elimination row by row, over all matrices at once: they have few rows and there are many.
    """
    by = np.array(sizes)
    entry = {place: values[..., None] * by**2 for place, values in gram.items()}
    sides = [values[..., None] * by for values in side]
    determinant = np.ones(())
    quad = np.zeros(())
    for j in range(len(side)):
        # A pivot of I + s² G is 1 at least, but for roundings.
        pivot = np.maximum(1.0 + entry[j, j], 1.0)
        determinant = determinant * pivot
        quad = quad + sides[j] ** 2 / pivot
        for i in range(j + 1, len(side)):
            share = entry[i, j] / pivot
            sides[i] = sides[i] - share * sides[j]
            for k in range(i, len(side)):
                entry[k, i] = entry[k, i] - share * entry[k, j]
    return np.log(determinant), quad
