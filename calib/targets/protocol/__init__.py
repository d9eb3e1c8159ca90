"""The protocol of a target finder: what it is asked for, what it answers, and finders in files of a user's own."""
