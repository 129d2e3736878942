"""Physical imperfections of the arm, one file each, by exact physics."""

from armd.simulator.truth.effects.base import Effect

__all__ = ["Effect"]
