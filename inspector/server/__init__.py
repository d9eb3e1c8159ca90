"""The locked-down viser server, its worker thread and background jobs."""
