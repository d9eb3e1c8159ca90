"""What changes the page's state: datasets, models, comparisons."""
