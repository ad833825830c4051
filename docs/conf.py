"""Settings of the site: Sphinx with MyST for Markdown, and the theme Furo."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import tsd_twin

sys.path.insert(0, str(Path(__file__).parent / "_site"))  # The extensions of this folder.

project = "tsd-twin"
author = "the authors of tsd-twin"
version = release = tsd_twin.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "command_reference",
    "math_as_mathml",
    "pages_as_on_github",
]
exclude_patterns = ["img", "_site"]
default_role = "literal"  # Docstrings put code between single backticks.

# Pages are written for GitHub first: its anchors, its dollar signs, its fences.
myst_enable_extensions = ["dollarmath", "html_image"]
myst_dmath_double_inline = True
myst_fence_as_directive = ["math"]
myst_heading_anchors = 6
myst_links_external_new_tab = False

# Where the source is to be read on the web, with the branch: https://github.com/me/it/blob/main.
# Without it, links to source files are shown as the names that they are.
source_url = os.environ.get("SOURCE_URL", "")

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
maximum_signature_line_length = 88
napoleon_google_docstring = True
napoleon_numpy_docstring = False

html_theme = "furo"
html_title = f"tsd-twin {release}"
html_math_renderer = "mathml"
html_static_path = ["_site/static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False
