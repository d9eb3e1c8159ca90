"""State of the page without viser: the session of a dataset, the view on it, undo, and the session file."""
