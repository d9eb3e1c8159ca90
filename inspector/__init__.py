"""The inspector: commands and a browser app over `calib`."""
