"""Diagnosis: the search for missing effects, step by step, and the rules that decide the verdict."""
