"""What may be wrong around an arm, or is wrong with it as workshops have it; shapes of size one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from outsider.faults import G_M_S2, cantilever, healthy, inner
from outsider.measured import Rng
from outsider.scene import Fault, Scene


def alloy(rng: Rng, scene: Scene) -> list[Fault]:
    """The artefact is of another alloy than its certificate says: it grows otherwise."""
    by = scene.readings.lever * (scene.readings.artefact_k * scene.on)[:, None]
    alter = replace(scene.none(), target=rng.choice([-1.0, 1.0]) * by)
    return [Fault("artefact_expansion", "artefact", ("artefact_c",), alter, "", largest=2.4e-5)]


def certificate(rng: Rng, scene: Scene) -> list[Fault]:
    """One target stands farther out than its certificate says, away from the artefact's middle."""
    readings = scene.readings
    far = np.linalg.norm(readings.lever, axis=1)
    number = int(rng.choice(np.unique(readings.target[far > 50.0])))
    off = (readings.target == number) & scene.on
    target = np.where(off[:, None], readings.lever / np.maximum(far, 1.0)[:, None], 0.0)
    return [
        Fault("artefact_length", f"target B{number + 1}", ("target",),
              replace(scene.none(), target=target), "", largest=0.5)
    ]  # fmt: skip


def replaced(rng: Rng, scene: Scene) -> list[Fault]:
    """An encoder is replaced: from then on its zero is another, and its disc off its axis."""
    k, at = inner(rng, scene), rng.uniform(0.3, 0.7) * scene.span_s
    phase, share = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 1.0)
    after, q = scene.since_s > at, scene.readings.q[:, k]
    by = after * (1 + share * np.sin(q - phase))
    place = f"joint {k + 1}"
    return [
        Fault("encoder_slip", place, ("time_s", f"q{k + 1}"), scene.at_joint(k, by),
              f"after {at / 3600:.2f} h, eccentric by {share:.2f} of the step",
              same_signal=(("encoder_eccentricity", place),),
              shapes=(scene.at_joint(k, 1.0 * after), *scene.waves_at(k, (q,), after)))
    ]  # fmt: skip


def table(rng: Rng, scene: Scene) -> list[Fault]:
    """The arm stands on a table that gives way: its weight's moment tilts all of it, along one edge
    half as much, or less, as along the other. No name of the contract's is this one."""
    machine, (_, middles) = scene.machine, healthy(scene)
    weights = G_M_S2 * machine.mass_kg[:, None] * np.array(scene.down)
    moment = np.cross(middles, weights[None]).sum(axis=1)
    edge, share = rng.uniform(0, np.pi), rng.uniform(0.0, 0.5)
    weak = np.array([np.cos(edge), np.sin(edge), 0.0])
    tilt = share * moment + (1 - share) * (moment @ weak)[:, None] * weak
    base = np.concatenate([np.zeros_like(tilt), tilt], axis=1) * scene.on[:, None]
    alter = replace(scene.none(), base=base / np.abs(tilt).max())
    variables = tuple(f"q{j + 1}" for j in range(machine.joints))
    return [
        Fault("table", "link 1", variables, alter, f"{share:.2f} the other way",
              rivals=(("link_bending", (cantilever(scene, 0),)),))
    ]  # fmt: skip


AROUND: dict[str, Callable[[Rng, Scene], list[Fault]]] = {
    "alloy": alloy, "certificate": certificate, "replaced": replaced, "table": table,
}  # fmt: skip
