"""A live server: hostile clients, an honest page, and thousands of operations."""
