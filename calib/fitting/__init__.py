"""The distance and position residuals, the trust-region solver and its robust weights (Jang 2025, eq 9-16)."""
