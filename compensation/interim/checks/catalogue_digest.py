"""A digest of the causes and growths that the columns of a reduced check belong to."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.checks.open_growth import OpenGrowth


def hash_catalogue(causes: Sequence[Cause], growth: Sequence[OpenGrowth] = ()) -> str:
    """Compute the SHA-256 of all causes' columns and of the unknown *growth*.

    Only an identical catalogue has the same digest.
    """
    columns = [(c.place, column) for c in (cause.candidate for cause in causes)
               for column in c.columns]  # fmt: skip
    text = "\n".join(
        f"{place} {column.name} {[term.model_dump_json() for term in column.terms]}"
        for place, column in columns
    )
    text += "".join(
        f"\n{expansion.name} {expansion.made_k:.9g} {expansion.size:.9g}" for expansion in growth
    )
    return hashlib.sha256(text.encode()).hexdigest()
