"""Which effect is missing: selected step by step, decided by rules, explained in words."""
