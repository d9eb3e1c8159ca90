"""Results as documents: plain dicts with the keys of the commands' `--json`, which scripts rely on."""
