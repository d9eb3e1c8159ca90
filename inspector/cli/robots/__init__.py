"""Commands on robot files, datasets made from a user's files, and samples."""
