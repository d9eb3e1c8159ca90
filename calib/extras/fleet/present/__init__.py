"""What is told of a fleet and of what arms of a type share."""
