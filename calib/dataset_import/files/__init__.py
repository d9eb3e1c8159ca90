"""What a user has: files in a folder or a zip, and what each of them is."""
