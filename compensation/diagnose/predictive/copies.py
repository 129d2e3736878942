"""Noise that copies of one posture share, where a refit weighs each copy as if it were its own.

Copies share a part ρ of their noise. The refit gives m of them the weight of m / (1 + (m − 1) ρ)
averaged readings (`estimate/noise/postures.py`) and takes them as independent. That is right for
columns that are the same in all copies, and not for those that differ: what goes by the approach,
the time or a temperature. So residuals have the covariance of a weighted fit under another noise
(the sandwich: P. J. Huber, Proc. 5th Berkeley Symp. 1, 221, 1967).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from armd.arrays import F64, I64, Mask
from armd.compensation.diagnose.constants import AXES
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.estimate.linear.blocks import Blocks, Piece


@dataclass(frozen=True)
class Copies:
    """The noise of averaged readings in units of what the refit takes it for.

    Copies are readings of one placement, so that each shared noise belongs to one piece.
    """

    own_share: F64  # (n,) variance of a rest's own noise
    shared_size: F64  # (n,) standard deviation of what it shares with the copies of its posture
    number: I64  # (n,) of the posture, piece by piece; −1 of a rest without copies
    parts: tuple[slice, ...]  # of each piece, which of the s shared noises are in it
    crossings: tuple[F64, ...]  # of each piece (c, s_p) products of its columns with these
    absorbed: F64  # (b, b) covariance of all that is absorbed of noise alone
    amplitudes: F64  # (b, b) that of the fitted amplitudes

    @classmethod
    def from_fit(cls, fit: Fit, white: Blocks) -> Copies | None:
        """Return the copies of a *fit* whose columns are *white*; None where there are none."""
        posture, noise = fit.linear.rests.posture, fit.noise
        is_copied = np.bincount(posture)[posture] > 1
        if not is_copied.any():
            return None
        counts = np.broadcast_to(noise.counts, len(posture))
        own_share = np.where(is_copied, counts * (1.0 - noise.shared_part), 1.0)
        shared_size = np.where(is_copied, np.sqrt(counts * noise.shared_part), 0.0)
        number, parts = _number_by_piece(posture, is_copied, white.pieces)
        gram = fit.problem.gram + np.diag(1.0 / fit.problem.variance)
        crossings = []
        for piece, part in zip(white.pieces, parts, strict=True):
            rows = piece.values.reshape(-1, len(piece.columns))
            excess = np.repeat(own_share[piece.rests] - 1.0, AXES)
            crossing = np.zeros((part.stop - part.start, len(piece.columns)))
            local = number[piece.rests]
            copied = np.flatnonzero(local >= 0)
            places = AXES * local[copied, None] + np.arange(AXES) - part.start
            sized = shared_size[piece.rests[copied], None, None] * piece.values[copied]
            np.add.at(crossing, places, sized)
            gram[np.ix_(piece.columns, piece.columns)] += (
                rows.T @ (excess[:, None] * rows) + crossing.T @ crossing
            )
            crossings.append(crossing.T)
        absorbed = fit.problem.project(fit.problem.project(gram).T)
        turn = fit.problem.project(np.eye(len(gram))).T
        amplitudes = turn @ absorbed @ turn.T
        return cls(own_share, shared_size, number, parts, tuple(crossings), absorbed, amplitudes)

    def make_sizes(self, motion: F64) -> csr_array:
        """Return the sizes (n, s) of the shared noises in products with a *motion* (n, 3)."""
        is_copied = self.number >= 0
        sizes = (self.shared_size[:, None] * motion)[is_copied]
        starts = AXES * np.concatenate([[0], np.cumsum(is_copied)])
        columns = AXES * self.number[is_copied, None] + np.arange(AXES)
        return csr_array(
            (sizes.ravel(), columns.ravel(), starts), shape=(len(motion), self.parts[-1].stop)
        )


def _number_by_piece(
    posture: I64, is_copied: Mask, pieces: tuple[Piece, ...]
) -> tuple[I64, tuple[slice, ...]]:
    """Return the number (n,) of each rest's posture, and the shared noises of each piece."""
    number, parts, first = np.full(len(posture), -1), [], 0
    for piece in pieces:
        copied = piece.rests[is_copied[piece.rests]]
        postures, local = np.unique(posture[copied], return_inverse=True)
        number[copied] = first + local
        parts.append(slice(AXES * first, AXES * (first + len(postures))))
        first += len(postures)
    return number, tuple(parts)
