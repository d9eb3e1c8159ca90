"""Results as HTML for a notebook, in tables and words; `inspector.notebook` has the same with figures."""
