"""How Sphinx builds the site (make docs). Neither the build nor its pages fetch anything from the network."""

from importlib.metadata import version as version_of
from pathlib import Path

from docutils import nodes
from sphinx import addnodes

ROOT = Path(__file__).resolve().parents[1]

project = "anm_mj"
copyright = "anm_mj contributors"
release = version = version_of("anm-mj")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["templates"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}

html_theme = "furo"
html_title = "anm_mj"
html_show_sphinx = False
html_static_path = ["_static"]
html_css_files = ["copy.css"]
html_js_files = [("copy.js", {"defer": "defer"})]

# Links to headings as GitHub makes them, so that pages read the same there and here.
myst_heading_anchors = 4
myst_all_links_external = False

autodoc_typehints = "description"
autodoc_member_order = "bysource"


def _keep_sentence(app, what, name, obj, options, lines):
    """Napoleon takes what stands before a colon in the first line of an attribute for its type; there is none."""
    if what in ("attribute", "data", "property"):
        lines.insert(0, "")


def _link_files(app, doctree):
    """Make links of the files that a page names: to their pages, or to copies of them."""
    for name in list(doctree.findall(nodes.literal)):
        path = name.astext()
        if "/" not in path or isinstance(name.parent, nodes.reference) or not (ROOT / path).is_file():
            continue
        if path.startswith("docs/") and path.endswith(".md"):
            options = {"refdomain": "std", "reftype": "doc", "refexplicit": True, "refwarn": True}
            link = addnodes.pending_xref("", reftarget="/" + path[len("docs/") : -len(".md")], **options)
            link["refdoc"] = app.env.docname
        else:
            link = addnodes.download_reference("", reftarget="/../" + path, refdoc=app.env.docname)
        name.replace_self(link)
        link += name


def setup(app):
    """Have docstrings prepared before Napoleon, whose priority is 500, reads them."""
    app.connect("autodoc-process-docstring", _keep_sentence, priority=400)
    # Before Sphinx collects the files to copy.
    app.connect("doctree-read", _link_files, priority=100)
