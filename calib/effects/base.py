"""Names that a file of user-defined effects may import; `calib` itself exports `Effect` and `Parameter`, too."""

from calib.effects.effect import Effect, NaturalBound, Parameter

__all__ = ["Effect", "NaturalBound", "Parameter"]
