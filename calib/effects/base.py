"""Names that a file of user-defined effects may import, in addition to those of `calib` itself."""

from calib.effects.effect import Effect, NaturalBound, Parameter

__all__ = ["Effect", "NaturalBound", "Parameter"]
