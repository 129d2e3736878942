"""Points and covariances of a batch and of the live path, against plain numpy written for it.

Here a joint is a product of 4 × 4 matrices, its derivatives the same with one of them replaced, and
the covariance J Σ J' with nothing left out.
"""

from __future__ import annotations

import numpy as np

from armd import POINT
from armd.compensation.kernel.model import Model
from support.drawn_calibration import REFERENCE_C, WARM, an_arm, calibrated, term
from support.readings import states_of

N_JOINTS = 6
ARM = an_arm(N_JOINTS)
LETTERS = ("theta", "d", "a", "alpha", "beta")
PARAMETERS = [f"{letter}_{k}" for k in range(1, N_JOINTS + 1) for letter in LETTERS]
TERMS = [
    term("a_2", WARM, coefficient=1e-2),
    term("theta_3", {"kind": "sin", "joint": 3}, coefficient=1e-3),
]
CELSIUS = np.array([26.0, 23.5])
ENCODER_RAD, TEMPERATURE_C, READING_MM = 2e-6, 0.05, 3e-3
#: xx xy xz yy yz zz.
UPPER = np.triu_indices(3)


def screw(axis: int, turn: np.ndarray | float, shift: np.ndarray | float) -> np.ndarray:
    """Matrices (n, 4, 4) that turn by *turn* (n,) about an axis and shift by *shift* along it."""
    turn, shift = np.broadcast_arrays(np.atleast_1d(turn), np.atleast_1d(shift))
    matrix = np.tile(np.eye(4), (len(turn), 1, 1))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[:, i, i] = matrix[:, j, j] = np.cos(turn)
    matrix[:, j, i], matrix[:, i, j] = np.sin(turn), -np.sin(turn)
    matrix[:, axis, 3] = shift
    return matrix


def generator(axis: int, is_turn: bool) -> np.ndarray:
    """What a screw's derivative is, times the screw."""
    matrix = np.zeros((4, 4))
    if is_turn:
        matrix[(axis + 2) % 3, (axis + 1) % 3], matrix[(axis + 1) % 3, (axis + 2) % 3] = 1.0, -1.0
    else:
        matrix[axis, 3] = 1.0
    return matrix


#: Of θ, d, a, α, β.
GENERATORS = [
    generator(*kind) for kind in ((2, True), (2, False), (0, False), (0, True), (1, True))
]


def by_numpy(q: np.ndarray, constants: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tips (n, 3), derivatives (n, 3, 30), and by theta_3's term's coefficient (n, 3)."""
    rows = np.tile(constants, (len(q), 1))
    warm = WARM["weights"]["t1"] * CELSIUS[0] + WARM["weights"]["t2"] * CELSIUS[1] - REFERENCE_C
    rows[:, PARAMETERS.index("a_2")] += 1e-2 * warm
    rows[:, PARAMETERS.index("theta_3")] += 1e-3 * np.sin(q[:, 2])
    x, y, z, rx, ry, rz = constants[-6:]
    before = screw(2, rz, 0.0) @ screw(1, ry, 0.0) @ screw(0, rx, 0.0)
    before[:, :3, 3] = x, y, z
    screws, prefixes = [], []
    for k in range(N_JOINTS):
        theta, d, a, alpha, beta = rows[:, 5 * k : 5 * k + 5].T
        screws += [
            screw(2, q[:, k] + theta, 0.0), screw(2, 0.0, d), screw(0, 0.0, a),
            screw(0, alpha, 0.0), screw(1, beta, 0.0),
        ]  # fmt: skip
    for one in screws:
        prefixes.append(before)
        before = before @ one
    beyond = np.tile(np.append(constants[5 * N_JOINTS : 5 * N_JOINTS + 3], 1.0), (len(q), 1))
    tip = np.einsum("nij,nj->ni", before, beyond)[:, :3]
    derivatives = np.empty((len(q), 3, len(PARAMETERS)))
    for column in reversed(range(len(PARAMETERS))):
        beyond = np.einsum("nij,nj->ni", screws[column], beyond)
        moved = beyond @ GENERATORS[column % 5].T
        derivatives[:, :, column] = np.einsum("nij,nj->ni", prefixes[column], moved)[:, :3]
    return tip, derivatives, derivatives[:, :, 10] * np.sin(q[:, 2])[:, None]


def test_a_thousand_points() -> None:
    rng = np.random.default_rng(4)
    # Correlated as a fit's results are: most of a parameter's variance no point ever shows.
    scale = np.array(
        [1e-2 if name[0] in "da" and "alpha" not in name else 1e-5 for name in PARAMETERS]
    )
    root = rng.normal(size=(32, 32)) * np.append(scale, [1e-4, 1e-5])[:, None]
    root[:, :3] *= 30.0
    identified = root @ root.T
    noise = {
        "encoder_rad": [ENCODER_RAD] * N_JOINTS, "temperature_c": TEMPERATURE_C,
        "reading_mm": READING_MM,
    }  # fmt: skip
    calibration = calibrated(
        ARM, TERMS, noise=noise, covariance_of=[*PARAMETERS, "term 0", "term 1"],
        covariance=identified.tolist(),
    )  # fmt: skip
    model, constants = Model(ARM, calibration), calibration.content.vector(N_JOINTS)
    model.fold(CELSIUS, 0.0)
    warm = float(np.dot([0.4, 0.6], CELSIUS) - REFERENCE_C)
    q = rng.uniform(-3, 3, (1000, N_JOINTS))
    tip, derivatives, by_term = by_numpy(q, constants)
    a_2 = derivatives[:, :, PARAMETERS.index("a_2")]
    by_all = np.dstack([derivatives, warm * a_2, by_term])
    covariance = np.matmul(by_all @ identified, np.swapaxes(by_all, 1, 2))
    angles = ENCODER_RAD * derivatives[:, :, ::5]
    sensors = 1e-2 * TEMPERATURE_C * a_2[:, :, None] * np.array([0.4, 0.6])
    for part in (angles, sensors):
        covariance += part @ np.swapaxes(part, 1, 2)
    covariance += READING_MM**2 * np.eye(3)
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    scales = np.sqrt(variance[:, UPPER[0]] * variance[:, UPPER[1]])

    nothing = np.full((len(q), N_JOINTS), np.nan), np.full((len(q), 3), np.nan)
    states = states_of(q, temperature_c=np.tile(CELSIUS, (len(q), 1)), time_s=np.zeros(len(q)))
    slow = model.slow_values(states)
    points = np.zeros(len(q), POINT)
    model.correct(q, *nothing, points)
    for position, found in (
        (model.position_rows(states, slow), model.covariance_rows(states, slow)),
        (points["position_mm"], points["covariance_mm2"]),
    ):
        assert np.abs(position - tip).max() < 1e-9
        assert (np.abs(found - covariance[:, *UPPER]) / scales).max() < 1e-6
