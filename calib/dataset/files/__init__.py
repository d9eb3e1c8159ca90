"""The dataset folder: TOML and CSV files read, checked and written."""
