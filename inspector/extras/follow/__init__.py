"""A campaign while it is measured: the command `follow`, and the tab Live."""
