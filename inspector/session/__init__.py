"""What is known of a dataset and what is on show, and the session file. No viser."""
