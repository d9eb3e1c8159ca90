"""Dataset in, fitted model out, with errors before and after, uncertainty and plausibility."""
