"""Which physical effect is missing: screening, evidence, stepwise selection, tests of the residual."""
