"""Configuration of the documentation site, which `./lab docs` builds: see https://www.sphinx-doc.org."""

import os
import shutil
import sys
from pathlib import Path

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS.parent), str(DOCS)]
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # for `!labkit` in notebooks

from site_pages import docstrings, laboratory, links, mathml, navigation, reference, repository  # noqa: E402

import labkit  # noqa: E402

project = "labkit"
author = "The labkit developers"
version = release = labkit.__version__
copyright = "the labkit developers, GPL 2.0 or later"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]
exclude_patterns = ["_build", "**/.ipynb_checkpoints"]
suppress_warnings = [
    "myst.header",  # results/hard_cases/README.md goes from # to ###
    "config.cache",  # functions in this file cannot be pickled
    "misc.highlighting_failure",  # commands of the shell in tutorials that are not executed
]

# --- pages -----------------------------------------------------------------------------------------------------------
myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
smartquotes_action = "qe"  # quotes and dots, but no dashes: options begin with two hyphens
myst_links_external_new_tab = False

# --- notebooks: stored without outputs, executed here, and again only if their cells change ---------------------------
nb_execution_mode = "cache"
nb_execution_cache_path = str(DOCS.parent / "build" / "docs_notebooks")
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_execution_timeout = 1800
nb_merge_streams = True
nb_ipywidgets_js = {}  # no scripts from other servers: the site opens without a network
IPYTHON = DOCS.parent / "build" / "ipython"  # instead of the settings of whoever builds the site
os.environ["IPYTHONDIR"] = str(IPYTHON)
(IPYTHON / "profile_default").mkdir(parents=True, exist_ok=True)
(IPYTHON / "profile_default" / "ipython_kernel_config.py").write_text(
    'get_config().IPKernelApp.log_level = "ERROR"  # no warning about TCP: notebooks and kernels are on one computer\n'
)

# --- reference -------------------------------------------------------------------------------------------------------
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autosummary_generate = False
add_module_names = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 90
viewcode_line_numbers = True

# --- appearance ------------------------------------------------------------------------------------------------------
html_theme = "furo"
html_title = f"labkit {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_show_search_summary = False  # it reads the pages found, which browsers refuse for a site opened from a file
html_math_renderer = "mathml"
pygments_style = "friendly"
copybutton_prompt_text = r">>> |\$ "
copybutton_prompt_is_regexp = True


def setup(app):
    """Generate the pages that are derived from the code, and add those of the repository that are linked."""
    for left in (DOCS / "tutorials").iterdir():  # by an earlier execution, which a changed tutorial could not resume
        if left.suffix != ".md":
            shutil.rmtree(left) if left.is_dir() else left.unlink()
    reference.write(DOCS / "reference")
    mathml.setup(app)
    docstrings.setup(app)
    repository.setup(app)
    navigation.setup(app)
    laboratory.setup(app)
    links.setup(app)
