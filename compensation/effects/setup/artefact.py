"""The artefact differs from its certificate: its expansion, its lengths, one target."""

from collections.abc import Iterator

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import ArtefactChange, Candidate, Column, Effect, SessionFacts
from armd.compensation.wording import format_plain


def _name_artefacts(facts: SessionFacts) -> list[tuple[str, str]]:
    """Return each artefact's name and its suffix in columns; a single artefact has neither."""
    if len(facts.artefacts) < 2:
        return [("", "")]
    return [(name, f" of {name}") for name in facts.artefacts]


def _describe_artefact(candidate: Candidate) -> str:
    change = candidate.columns[0].artefact
    return f" of {change.artefact}" if change is not None and change.artefact else ""


def list_expansions(facts: SessionFacts) -> Iterator[Candidate]:
    if facts.artefact_c:
        for name, suffix in _name_artefacts(facts):
            change = ArtefactChange("expansion", artefact=name)
            column = Column(f"per kelvin{suffix}", "1/K", 2.5e-6, artefact=change)
            yield Candidate("artefact_expansion", location.ARTEFACT, (column,), ("artefact_c",))
    if facts.artefact_unread and facts.sensors:
        for name, suffix in _name_artefacts(facts):
            change = ArtefactChange("warmth", artefact=name)
            column = Column(f"per kelvin of the arm{suffix}", "1/K", 10e-6, artefact=change)
            yield Candidate("artefact_expansion", location.ARTEFACT, (column,), facts.sensors)


def list_lengths(facts: SessionFacts) -> Iterator[Candidate]:
    for name, suffix in _name_artefacts(facts):
        scale = Column(
            f"scale{suffix}", "1", 20e-6, artefact=ArtefactChange("scale", artefact=name)
        )
        yield Candidate("artefact_length", location.ARTEFACT, (scale,), ("target",))
    for name in facts.targets:
        columns = tuple(
            Column("xyz"[axis], "mm", 10e-3, artefact=ArtefactChange("target", name, axis))
            for axis in range(3)
        )
        yield Candidate("artefact_length", location.target(name), columns, ("target",))
    for index, name in enumerate(facts.distances):
        change = ArtefactChange("distance", name, index=index)
        column = Column(f"distance {name}", "mm", 50e-3, artefact=change)
        yield Candidate("artefact_length", location.ARTEFACT, (column,), ("target",))


def read_expansion(candidate: Candidate, amplitudes: F64) -> str:
    excess = format_plain(amplitudes[0] * 1e6, sign="+")
    change = candidate.columns[0].artefact
    which = change.artefact if change is not None and change.artefact else "the artefact"
    if change is not None and change.kind == "warmth":
        return (
            f"{which} expands by {excess} µm per metre and kelvin more, "
            "if it is as warm as the arm: read its temperature (artefact_c)"
        )
    return f"{which} expands by {excess} µm per metre and kelvin more"


def read_length(candidate: Candidate, amplitudes: F64) -> str:
    if candidate.columns[0].name.startswith("scale"):
        off = format_plain(amplitudes[0] * 1e6, sign="+")
        return f"all certified positions{_describe_artefact(candidate)} are {off} µm per metre off"
    size = float(np.linalg.norm(amplitudes)) * 1e3
    subject = candidate.location if len(amplitudes) == 3 else candidate.columns[0].name
    return f"{subject} is {format_plain(size)} µm from its certificate"


EXPANSION = Effect(
    "artefact_expansion",
    "the artefact is of another material, or warmer than its sensor says",
    "the expansion of all links together; lag",
    "measure a second artefact of another material at the same temperatures",
    list_expansions,
    read_expansion,
    "temperatures of the artefact (artefact_c), or of the arm instead, that vary over the readings",
)
LENGTH = Effect(
    "artefact_length",
    "a certificate is old, a ball was loosened, a length copied wrong",
    "the arm's own scale, with one artefact",
    "have the target measured again, or add a second artefact",
    list_lengths,
    read_length,
    "certified positions or lengths that can contradict each other, or a calibration to test",
    accident=True,
)
EFFECTS = (EXPANSION, LENGTH)
