"""The jig's faces by themselves: where their edges lie, and angles that may be relied on."""
