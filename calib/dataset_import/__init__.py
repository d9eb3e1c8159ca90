"""Import of a dataset from a robot and a user's tables: columns recognised by name, units by name or by fit."""
