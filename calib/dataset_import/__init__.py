"""A dataset folder from a robot and the tables that a user has: columns recognised by name, units said."""
