"""Covariance of the fitted planes where neighbouring points share errors (spatially correlated noise)."""
