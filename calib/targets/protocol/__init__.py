"""Protocol of a target finder: its request, its answer, and finders in files of a user's own."""
