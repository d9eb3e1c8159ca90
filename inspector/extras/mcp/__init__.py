"""The commands as tools of the Model Context Protocol, for agents: what each takes, where it may read and write."""
