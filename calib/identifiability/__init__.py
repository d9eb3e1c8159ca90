"""Identifiability of parameters: Pearson redundancy (Park 2022, section 3) and structural rank."""
