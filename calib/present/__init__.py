"""Presentation of results: each is built once as blocks, rendered as text or HTML; `inspector` adds the figures.

A module here makes the blocks of one kind of result; a panel of the page, a section of the report and a notebook's view
are a choice of them. `results.presentation` and `results.document` find what belongs to a result by its class.
"""

from calib.present import calibration as calibration
from calib.present import changes as changes
from calib.present import checks as checks
from calib.present import corners as corners
from calib.present import correction as correction
from calib.present import dataset as dataset
from calib.present import diagnosis as diagnosis
from calib.present import fleets as fleets
from calib.present import plans as plans
from calib.present import redundancy as redundancy
from calib.present import tool_place as tool_place
from calib.present import validation as validation
from calib.present.results import document, headline, notebook_html, presentation, summary, to_dict

__all__ = ["document", "headline", "notebook_html", "presentation", "summary", "to_dict"]
