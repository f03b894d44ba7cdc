"""How Sphinx builds the site (make docs). Neither the build nor its pages fetch anything from the network."""

from importlib.metadata import version as version_of

project = "anm_mj"
copyright = "anm_mj contributors"
release = version = version_of("anm-mj")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["templates"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}

html_theme = "furo"
html_title = "anm_mj"
html_show_sphinx = False

# Links to headings as GitHub makes them, so that pages read the same there and here.
myst_heading_anchors = 4
myst_all_links_external = False

autodoc_typehints = "description"
autodoc_member_order = "bysource"


def _keep_sentence(app, what, name, obj, options, lines):
    """Napoleon takes what stands before a colon in the first line of an attribute for its type; there is none."""
    if what in ("attribute", "data", "property"):
        lines.insert(0, "")


def setup(app):
    """Have docstrings prepared before Napoleon, whose priority is 500, reads them."""
    app.connect("autodoc-process-docstring", _keep_sentence, priority=400)
