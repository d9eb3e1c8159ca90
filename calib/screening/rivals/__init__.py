"""Causes in doubt of which one is true: what each predicts at further poses, and which of these tell them apart."""
