"""The public place of what a user's own effect imports; `from calib import Effect, Parameter` is the same."""

from calib.effects.effect import Effect, Parameter

__all__ = ["Effect", "Parameter"]
