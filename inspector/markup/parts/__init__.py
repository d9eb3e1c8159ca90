"""What all markup is made of: elements, numbers, colours."""
