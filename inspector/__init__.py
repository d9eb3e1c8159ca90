"""The inspector: commands and a browser app over `calib`."""

import calib  # noqa: F401  before numpy: it sets how many threads BLAS has
