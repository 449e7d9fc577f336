"""Sphinx configuration; README.md has the build command.

Pages need no network: MathJax is copied along, and the theme brings its own styles. While the site
is built, notebooks and examples are run, and the live page of Fig. 7 on the start page is computed.
Pages are plain Markdown, which can be read without a build: the code of the examples and what they
print are put below their links here.
"""

import os
import re
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
exclude_patterns = ["_build", "**/.ipynb_checkpoints"]

nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600
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


NOTEBOOK = """---
file_format: mystnb
kernelspec:
  name: python3
---

```{code-cell}
:tags: [remove-cell]

import os
import subprocess
import sys
from pathlib import Path

from IPython.display import Image, display


def run(name, *files):
    script = Path(os.environ["CONTIMPACT_EXAMPLES"]) / f"{name}.py"
    command = [sys.executable, script, *files]
    print(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)
    for file in files:
        if file.endswith(".png"):
            display(Image(file, width=640))
```

"""
"""The head of the page of examples: a notebook that runs scripts and shows their pictures."""
EXAMPLE = re.compile(
    r"^\[(\w+)\.py\]\(\.\./examples/\1\.py\): `python examples/\1\.py ?(.*)`$", re.MULTILINE
)
"""The link to an example, with the command that runs it."""


def run_examples(text):
    """The page of examples with their code, and cells that run them."""

    def shown(found):
        name, arguments = found.groups()
        given = ", ".join(f'"{text}"' for text in (name, *arguments.split()))
        code = f"```{{literalinclude}} ../examples/{name}.py\n:language: python\n```"
        return (
            f"{found[0]}\n\n{code}\n\n```{{code-cell}}\n:tags: [remove-input]\n\nrun({given})\n```"
        )

    return NOTEBOOK + EXAMPLE.sub(shown, text)


def setup(app):
    """Run the examples; write the live page once a site of HTML is built."""

    def read(app, name, source):
        if name == "examples":
            source[0] = run_examples(source[0])

    def finished(app, exception):
        if exception is None and app.builder.format == "html":
            write_live_page(app.outdir)

    app.connect("source-read", read)
    app.connect("build-finished", finished)
