"""How Sphinx builds the documentation: `./run docs`. Nothing that a page shows comes from the network."""

from __future__ import annotations

import logging
import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "extensions"))
sys.path.insert(0, str(HERE.parent))

_project = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
project = "Robot calibration inspector"
author = "robot calibration inspector contributors"
project_copyright = author
release = version = _project["version"]

extensions = [
    "myst_parser",
    "sphinx_design",
    "sphinx_copybutton",
    "sphinx.ext.autodoc",
    "mathml",  # docs/extensions, as all below
    "reference",
    "effects",  # docs/extensions: a page for each effect of the catalogue
    "commands",
    "gallery",
    "notebooks",  # docs/extensions: docs/notebooks/*.ipynb are run, and become pages
    "offline",
]
# An extra that was taken away takes its page with it; links to that are then no faults.
_gone = [
    f"extras/{page.name}"
    for page in sorted((HERE / "extras").glob("*.md"))
    if not any((HERE.parent / package / "extras" / page.stem).is_dir() for package in ("calib", "inspector"))
]
exclude_patterns = ["**/README.md", *_gone]

# ---- pages ----------------------------------------------------------------------------------------------------------
myst_enable_extensions = [
    "amsmath",
    "attrs_block",
    "attrs_inline",
    "colon_fence",
    "deflist",
    "dollarmath",
    "fieldlist",
]
myst_heading_anchors = 4  # a heading can be linked to by its words, as on GitHub
myst_update_mathjax = False
nitpicky = not _gone
suppress_warnings = ["autodoc.*", "design.*", "myst.xref_missing", "ref.*", "toc.*"] if _gone else []
numfig = False  # files and pictures are named, not numbered
math_numfig = False  # equations are counted page by page
math_eqref_format = "({number})"
html_math_renderer = "mathml"

# ---- the reference --------------------------------------------------------------------------------------------------
default_role = "named"  # `name` in a docstring: a link where the name has a page, else code
add_module_names = False
autodoc_default_options = {"undoc-members": True, "member-order": "bysource"}
smartquotes = False  # "" in a docstring is an empty text
autodoc_typehints_format = "short"
autodoc_type_aliases = {
    name: name for name in ("Array", "IndexArray", "BoolArray", "ByteArray", "ArrayLike", "NDArray")
}
python_maximum_signature_line_length = 90
python_use_unqualified_type_names = True

# ---- the gallery ----------------------------------------------------------------------------------------------------
gallery_order = (  # the others follow by name
    "error_falls",
    "corner_of_a_scan",
    "residual_over_joint",
    "learned_curves",
    "redundancy",
    "sigma_of_parameters",
    "repeats_and_covariance",
    "learning_curve",
    "planned_poses",
    "control_chart",
    "compare_two",
)

# ---- look -----------------------------------------------------------------------------------------------------------
html_theme = "furo"
html_title = f"Robot calibration inspector {version}"
html_short_title = "inspector"
html_static_path = ["static"]
html_css_files = ["docs.css"]
html_show_sphinx = False
html_show_search_summary = False  # it fetches each page found, which a browser refuses for files on disk
html_copy_source = False
html_theme_options = {
    "light_css_variables": {
        "color-brand-primary": "#0b5c8a",
        "color-brand-content": "#0b5c8a",
        "color-api-name": "#0b5c8a",
        "color-api-pre-name": "#5a5c63",
    },
    "dark_css_variables": {
        "color-brand-primary": "#6cc0ee",
        "color-brand-content": "#6cc0ee",
        "color-api-name": "#6cc0ee",
        "color-api-pre-name": "#9ca0a5",
    },
    "navigation_with_keys": True,
}
pygments_style = "friendly"
pygments_dark_style = "github-dark"
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True
linkcheck_ignore = [r"http://127\.0\.0\.1"]
linkcheck_timeout = 20
linkcheck_anchors = False  # pages of code hosts make their anchors by script

# A folder of pages may be empty.
logging.getLogger("sphinx.sphinx.directives.other").addFilter(lambda record: "glob pattern" not in record.msg)
