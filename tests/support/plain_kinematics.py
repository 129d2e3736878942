"""The contract's chain of 4 × 4 matrices, written out: truth for kinematics and for every cause."""

from __future__ import annotations

import numpy as np


def rotation(axis: int, angle: float | np.ndarray) -> np.ndarray:
    """Matrices (…, 4, 4) that turn about an axis (0…2) by *angle* (…)."""
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.zeros((*np.shape(angle), 4, 4))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[..., axis, axis] = matrix[..., 3, 3] = 1.0
    matrix[..., i, i] = matrix[..., j, j] = c
    matrix[..., i, j], matrix[..., j, i] = -s, s
    return matrix


def translation(way: np.ndarray) -> np.ndarray:
    """Matrices (…, 4, 4) that shift by *way* (…, 3)."""
    matrix = np.zeros((*np.shape(way)[:-1], 4, 4))
    matrix[...] = np.eye(4)
    matrix[..., :3, 3] = way
    return matrix


def links(q: np.ndarray, p: np.ndarray) -> list[np.ndarray]:
    """Matrices (n, 4, 4) that multiply to the tip's pose: the base's, each joint's, the tip's.

    Angles *q* (n, N) in rad, parameters *p* (n, 5 N + 9) in mm and rad.
    """
    n_joints = q.shape[1]
    of_joints, tip, base = np.split(p, [5 * n_joints, 5 * n_joints + 3], axis=1)
    turned = rotation(2, base[:, 5]) @ rotation(1, base[:, 4]) @ rotation(0, base[:, 3])
    found = [translation(base[:, :3]) @ turned]
    zero = np.zeros(len(q))
    for k in range(n_joints):
        theta, d, a, alpha, beta = of_joints[:, 5 * k : 5 * k + 5].T
        along = translation(np.stack([a, zero, d], axis=1))  # Tz(d)·Tx(a)
        turn = rotation(0, alpha) @ rotation(1, beta)
        found.append(rotation(2, q[:, k] + theta) @ along @ turn)
    return [*found, translation(tip)]


def frames(q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Poses (n, N + 1, 4, 4) of the base and of the frame at the end of each link."""
    pose, *rest = links(q, p)
    found = [pose]
    for link in rest[:-1]:
        found.append(pose := pose @ link)
    return np.stack(found, axis=1)


def tip_pose(q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Poses (n, 4, 4) of the tip."""
    return product(links(q, p))


def product(matrices: list[np.ndarray]) -> np.ndarray:
    """Matrices one after the other."""
    whole, *rest = matrices
    for matrix in rest:
        whole = whole @ matrix
    return whole
