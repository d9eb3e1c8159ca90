"""Small text files as users write them, read so that every error names the file and the place."""
