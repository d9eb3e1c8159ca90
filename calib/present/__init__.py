"""Presentation of results: each is built once as blocks (`calib.rendering`); `inspector` adds the figures.

Its rooms are `fit`, `cause`, `over_time` and `moves`; what stands beside them, names and references, serves all.

A module makes the blocks of one kind of result; a panel of the page, a section of the report and a notebook's view are
a choice of them. `results.presentation` and `results.document` find what belongs to a result by its class.
"""

from calib.present.results import document, headline, notebook_html, presentation, summary, to_dict

__all__ = ["document", "headline", "notebook_html", "presentation", "summary", "to_dict"]
