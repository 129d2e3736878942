"""Rotations of many rows at once, exact for any angle."""

from __future__ import annotations

import math

import numpy as np

from armd.arrays import F64

ARC_SECOND = np.pi / 180 / 3600  # rad


def rotate_about(vector: F64) -> F64:
    """Return rotation matrices (…, 3, 3) for rotation vectors (…, 3) in rad (Rodrigues)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    o = np.zeros_like(x)
    cross = np.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(*x.shape, 3, 3)
    # sin(t)/t and (1 − cos t)/t², which np.sinc keeps exact down to t = 0.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    rotation: F64 = np.eye(3) + first * cross + second * (cross @ cross)
    return rotation


def rotate_about_z(rotation: F64, angle: F64) -> F64:
    """Return rotation (n, 3, 3) · Rz(angle (n,)).

    Only two columns change, which is cheaper than a product.
    """
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    turned = np.empty_like(rotation)
    turned[:, :, 0] = c * rotation[:, :, 0] + s * rotation[:, :, 1]
    turned[:, :, 1] = c * rotation[:, :, 1] - s * rotation[:, :, 0]
    turned[:, :, 2] = rotation[:, :, 2]
    return turned


def make_tilt(alpha: float, beta: float) -> F64:
    """Return Rx(alpha)·Ry(beta), (3, 3)."""
    c, s = math.cos(alpha), math.sin(alpha)
    cb, sb = math.cos(beta), math.sin(beta)
    return np.array([[cb, 0.0, sb], [s * sb, c, -s * cb], [-c * sb, s, c * cb]])


def draw_directions(rng: np.random.Generator, n: int) -> F64:
    """Draw directions (n, 3) uniformly on the sphere."""
    vectors = rng.normal(size=(n, 3))
    unit: F64 = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit
