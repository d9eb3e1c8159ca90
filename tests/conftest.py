"""Settings that all tests share. The browser's fixtures are in browser_support.py."""

from __future__ import annotations

import os

from hypothesis import settings

# No deadline: a slow machine is not a wrong result. In CI the drawn inputs are the same on every run.
settings.register_profile("project", deadline=None, print_blob=True, derandomize=bool(os.environ.get("CI")))
settings.load_profile("project")
