"""What a camera sees: options of `calibrate` and `import`, and images with their reprojection on the page."""
