"""What a camera sees: options of `calibrate` and `import`."""
