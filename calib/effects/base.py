"""Names that a file of a user's own effects may import; `from calib import Effect, Parameter` gives two of them."""

from calib.effects.effect import Effect, NaturalBound, Parameter

__all__ = ["Effect", "NaturalBound", "Parameter"]
