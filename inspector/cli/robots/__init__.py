"""The commands about robots' files and what comes with them."""
