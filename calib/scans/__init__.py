"""One point cloud: loaded from any of its file formats, written, counted."""
