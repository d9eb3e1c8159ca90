"""Controllers, which change the page's state: datasets, models, comparisons."""
