"""Which parameters can be known: Pearson redundancy (Park 2022, section 3) and structural rank."""
