"""How the documents are built: `sphinx-build -W --keep-going -b html python/docs build/docs`."""

import sys
from pathlib import Path

import ambid

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "ambid"
author = "the authors of ambid"
release = version = ambid.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "pages", "mathml"]
exclude_patterns = ["_ext", "calibration/*"]
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
default_role = "py:obj"

autodoc_preserve_defaults = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False

html_theme = "furo"
html_title = f"ambid {release}"
html_math_renderer = "mathml"
html_show_copyright = False
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["ambid.css"]
