"""Sphinx configuration; the build command stands in README.md."""

from contimpact import __version__

project = "contimpact"
author = "the contimpact developers"
release = version = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]

autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_param = False
napoleon_use_rtype = False

html_theme = "alabaster"
html_theme_options = {
    "description": "Continuation of periodic orbits in impacting systems, ghosts included",
    "page_width": "1080px",
    "sidebar_width": "200px",
}
html_show_sourcelink = False
