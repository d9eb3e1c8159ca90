"""What a file of a user's own effects may import; `from calib import Effect, Parameter` gives the same."""

from calib.effects.effect import Effect, Parameter

__all__ = ["Effect", "Parameter"]
