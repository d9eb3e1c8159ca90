"""The model, the residuals of points, distances and poses (Jang 2025, eq 9-16), the solver and outlying poses."""
