"""The artefact sags between its supports, differently in each placement."""

from collections.abc import Iterator

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import ArtefactChange, Candidate, Column, Effect, SessionFacts
from armd.compensation.wording import format_plain


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    if not facts.targets:
        return
    for name in facts.artefacts if len(facts.artefacts) > 1 else ("",):
        for axis, along in enumerate(("its longest axis", "its second axis")):
            change = ArtefactChange("sag", axis=axis, artefact=name)
            label = f"along {along}{f' of {name}' if name else ''}"
            column = Column(label, "mm", 10e-3, artefact=change)
            yield Candidate("artefact_sag", location.ARTEFACT, (column,), ("placement", "target"))


def describe(candidate: Candidate, amplitudes: F64) -> str:
    size = format_plain(1e3 * abs(amplitudes[0]))
    return (
        f"the artefact bends by {size} µm under its own weight {candidate.columns[0].name}, when "
        "that lies level; no calibration can hold this"
    )


EFFECT = Effect(
    "artefact_sag",
    "a beam or plate is certified on its supports, and sags otherwise when it leans or rests on "
    "others",
    "a certificate that is wrong, bending of a link",
    "measure the artefact level, on edge and upright",
    list_candidates,
    describe,
    "certified positions, in placements that lean differently",
)
