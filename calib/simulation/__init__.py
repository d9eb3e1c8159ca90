"""Datasets with known truth: poses, scene and scanner."""
