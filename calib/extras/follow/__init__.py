"""A measuring campaign followed while it runs: each pose judged as it arrives, the fit, and the best next pose."""
