"""The same cell measured again: the command `watch`, the tab Watch, its figures and its page."""
