"""How a result shows itself: as a document, as HTML in a notebook, and how far long work has come."""
