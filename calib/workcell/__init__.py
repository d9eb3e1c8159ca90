"""The cell around an arm: what of a jig its scanner can see, where the arm can stand, in which order to go there."""
