"""The cell around an arm: which poses can be measured, which obstacles there are, and an order of poses."""
