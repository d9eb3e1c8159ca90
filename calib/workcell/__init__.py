"""The cell around an arm: which poses can be measured, what is in the way, and an order in which to visit them."""
