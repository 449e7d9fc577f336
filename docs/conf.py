"""Sphinx configuration; the build command stands in README.md.

Pages need no network: MathJax is copied along, and the theme brings its own styles. While the site
is built, notebooks and examples are run, and the live page of Fig. 7 on the start page is computed.
"""

import os
import shutil
import tempfile
from pathlib import Path

from contimpact import __version__
from contimpact.cli import main

project = "contimpact"
author = "the contimpact developers"
release = version = __version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
extensions += ["sphinx-mathjax-offline"]
myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build", "paper.md", "**/.ipynb_checkpoints"]

nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_execution_in_temp = True

autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_param = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"contimpact {version}"
html_show_sourcelink = False


ROOT = Path(__file__).resolve().parents[1]
FIG7 = ROOT / "branches/fig7"
os.environ["CONTIMPACT_EXAMPLES"] = str(ROOT / "examples")


def write_live_page(site):
    """Compute Fig. 7 and write its page, with the attractors that are kept, to live/fig7.html."""
    target = Path(site) / "live/fig7.html"
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        run = ["run", str(FIG7 / "scene.toml"), "-o", folder, "--no-plot", "-q"]
        failed = main(run)
        for sweep in FIG7.glob("simulation/sweep.csv*"):
            shutil.copy(sweep, folder)
        if failed or main(["plot", folder, "-o", str(target)]):
            raise RuntimeError("the live page of Fig. 7 could not be made")


def setup(app):
    """Write the live page once a site of HTML is built."""

    def finished(app, exception):
        if exception is None and app.builder.format == "html":
            write_live_page(app.outdir)

    app.connect("build-finished", finished)
