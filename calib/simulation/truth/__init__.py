"""The true arm and what acts on it; shares no code with what fits it."""
