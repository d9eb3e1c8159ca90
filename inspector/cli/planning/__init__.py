"""The command that plans poses."""
