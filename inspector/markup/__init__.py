"""HTML fragments, wording and colours. No viser."""
