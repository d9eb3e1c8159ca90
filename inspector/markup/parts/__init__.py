"""Common parts of all HTML: elements, numbers, colours."""
