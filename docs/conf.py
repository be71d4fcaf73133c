"""Sphinx configuration of the documentation site: `make docs`."""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "site"))  # extensions

from pyinfra import __version__

project = "infrasim"
copyright = "the infrasim contributors, Apache-2.0"
release = version = __version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "commands",
    "docstrings",
    "external_links",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["decisions", "gallery", "site"]
nitpicky = True
nitpick_ignore_regex = [
    ("py:.*", r"(numpy|pandas|matplotlib|collections|typing|os)\..*")
]  # no intersphinx

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_class_signature = "separated"
add_module_names = False
autodoc_typehints = "none"  # the parameters' descriptions say the types
autodoc_preserve_defaults = True
autodoc_default_options = {"exclude-members": "__init__, __new__"}
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
default_role = "code"

copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "examples",
    "filename_pattern": r"\.py$",
    "plot_gallery": os.environ.get("GALLERY", "ON") != "OFF",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "capture_repr": ("_repr_html_",),
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "min_reported_time": 1000,
    "remove_config_comments": True,
    "within_subsection_order": "FileNameSortKey",
}

html_theme = "furo"
html_title = "infrasim"
templates_path = ["site/templates"]
html_static_path = ["site/static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_use_index = False  # the glossary and the API page are in order
html_js_files = ["site.js"]
html_favicon = "site/static/favicon.svg"
