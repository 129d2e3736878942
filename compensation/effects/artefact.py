"""The artefact is not what its certificate says: its expansion, its lengths, one target."""

from collections.abc import Iterator

import numpy as np

from armd.compensation.effects.effect import (
    F64,
    ArtefactChange,
    Candidate,
    Column,
    Effect,
    Scene,
    plain,
)


def expansion(scene: Scene) -> Iterator[Candidate]:
    if scene.artefact_c:
        column = Column("per kelvin", "1/K", 2.5e-6, artefact=ArtefactChange("expansion"))
        yield Candidate("artefact_expansion", "artefact", (column,), ("artefact_c",))


def length(scene: Scene) -> Iterator[Candidate]:
    scale = Column("scale", "1", 20e-6, artefact=ArtefactChange("scale"))
    yield Candidate("artefact_length", "artefact", (scale,), ("target",))
    for name in scene.targets:
        columns = tuple(
            Column("xyz"[axis], "mm", 10e-3, artefact=ArtefactChange("target", name, axis))
            for axis in range(3)
        )
        yield Candidate("artefact_length", f"target {name}", columns, ("target",))
    for index, name in enumerate(scene.distances):
        change = ArtefactChange("distance", name, index=index)
        column = Column(f"distance {name}", "mm", 50e-3, artefact=change)
        yield Candidate("artefact_length", "artefact", (column,), ("target",))


def read_expansion(_: Candidate, amplitudes: F64) -> str:
    more = plain(amplitudes[0] * 1e6, sign="+")
    return f"the artefact expands by {more} µm per metre and kelvin more"


def read_length(candidate: Candidate, amplitudes: F64) -> str:
    if candidate.columns[0].name == "scale":
        return (
            f"all certified positions are {plain(amplitudes[0] * 1e6, sign='+')} µm per metre off"
        )
    size = float(np.linalg.norm(amplitudes)) * 1e3
    what = candidate.location if len(amplitudes) == 3 else candidate.columns[0].name
    return f"{what} is {plain(size)} µm from its certificate"


EXPANSION = Effect(
    "artefact_expansion",
    "the artefact is of another material, or warmer than its sensor says",
    "the expansion of all links together; lag",
    "measure a second artefact of another material at the same temperatures",
    expansion,
    read_expansion,
    "artefact temperatures (artefact_c) that vary over the readings",
)
LENGTH = Effect(
    "artefact_length",
    "a certificate is old, a ball was loosened, a length copied wrong",
    "the arm's own scale, with one artefact",
    "have the target measured again, or add a second artefact",
    length,
    read_length,
    "certified positions or lengths that can contradict each other, or a calibration to test",
    accident=True,
)
