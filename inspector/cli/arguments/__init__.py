"""Arguments of the subcommands."""
