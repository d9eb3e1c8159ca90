"""Point clouds of scans: loaded from any of their file formats, written, counted."""
