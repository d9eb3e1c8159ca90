"""Options of core's commands: a dataclass each, from which the command line is made. Nothing slow is imported."""
