"""Colours of the app, one meaning each, distinguishable for colour-blind readers.

Roles of poses and models are 20 and more apart for all eyes, and stand out from a light page and from a dark one with a
contrast of 3:1 (docs/guide/page.md).
"""

from __future__ import annotations

from calib.calibration import model_versions as models
from calib.rendering.colours import BAD as BAD
from calib.rendering.colours import DOUBT as DOUBT  # a corner, or a verdict, that deserves a second look
from calib.rendering.colours import EFFECTS, LINKS
from calib.rendering.colours import GOOD as GOOD
from calib.rendering.colours import NEUTRAL as NEUTRAL

ROLE_COLOURS = {"reference": "#A36DFB", "train": "#37859D", "test": "#D65642"}
FACE_COLOURS = ("#0072B2", "#E69F00", "#CC79A7")  # the three chosen faces, in the order of the corner's faces
GROUP_COLOURS = ("#88CCEE", "#DDCC77", "#44AA99", "#AA4499", "#999933", "#CC6677", "#117733", "#882255", "#6699CC")
MODEL_COLOURS = {models.NOMINAL: "#C68004", models.LINKS: LINKS, models.EFFECTS: EFFECTS[0]}
MODEL_BEFORE = "#8C939C"  # thin lines of the model before the one on show
BESIDE_COLOURS = ("#0074B5", "#D55E00")  # the calibration on show, and the one beside it
ARM, JOINT, SLIDE = "#C3C9D1", "#6B7787", "#8C7340"  # links; joints that turn; joints that slide
MEASURE = "#7F868F"  # the floor's grid and the bar of known length
HIGHLIGHT = "#E5006B"  # the selected corner, pose and joint
REJECTED = "#5F6B7A"  # what the choice of planes left out; darker than face 3, which some colour-blind eyes see as grey
FILTER_COLOURS = ("#17BECF", "#7E57C2", "#8D6E3F")  # sets that filter 1, 2, 3 rejected; no face has these
SCAN = "#6F7B8A"  # points of the selected scan that are on no face
UNKNOWN = "#8A8F98"  # of which nothing is known: a role, a pose; what noise alone leaves
FAILED = "#B3261E"
LEFT_OUT = UNKNOWN  # a pose that counts for nothing
PROPOSAL = "#0074B5"  # what to do next
# Viser makes lighter shades of this and gives a light page #0072B2; a dark page has its own (server/client/page.css).
BRAND = "#003654"


def rgb(colour: str) -> tuple[int, int, int]:
    """Colour (red, green, blue), 0-255 each, of "#RRGGBB"."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def role_colour(role: str) -> str:
    """Colour of a pose by its role."""
    return ROLE_COLOURS.get(role, UNKNOWN)
