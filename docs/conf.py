"""Sphinx configuration; build with `sphinx-build -W -b html docs docs/_build/html`."""

import sys
from pathlib import Path

import skhoid

sys.path.insert(0, str(Path(__file__).parent))  # effect_cards, gallery_pages

project = "skhoid"
author = "skhoid developers"
copyright = "2026, skhoid developers"
version = release = skhoid.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "numpydoc",
    "myst_parser",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "effect_cards",
]
source_suffix = {".rst": "restructuredtext", ".md": "markdown"}
templates_path = ["_templates"]
exclude_patterns = ["_build", "gallery/**/*.ipynb", "sg_execution_times.rst"]
default_role = "py:obj"

html_theme = "pydata_sphinx_theme"
html_title = f"skhoid {release}"
html_show_sourcelink = False
html_context = {"default_mode": "auto"}  # light or dark as the reader has it
html_static_path = ["_static"]
html_css_files = ["width.css"]
html_theme_options = {
    "header_links_before_dropdown": 7,  # the sections, all in sight
    "navbar_persistent": ["search-button"],
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "footer_start": ["copyright"],
    "footer_end": [],
}

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autosummary_generate = True
autodoc_typehints = "none"  # numpydoc's Parameters section gives the types
numpydoc_show_class_members = False  # the autosummary template lists them

copybutton_exclude = ".linenos, .gp, .go"

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/plot_",
    "doc_module": ("skhoid",),
    "backreferences_dir": "generated/backreferences",
    "image_scrapers": ("gallery_pages.pictures",),
    "subsection_order": [
        f"../examples/{topic}"
        for topic in (
            "diagnosis",
            "identify",
            "preprocess",
            "recursion",
            "simulate",
            "montecarlo",
            "frequency",
        )
    ],
    "within_subsection_order": "gallery_pages.PageOrder",
    "remove_config_comments": True,
    "download_all_examples": False,
    "show_signature": False,
    "parallel": 2,
}


def leave_out_sklearn_members(app, what, name, obj, skip, options):
    """Skip what scikit-learn's base classes bring along: its pages document it."""
    from_sklearn = (getattr(obj, "__module__", None) or "").startswith("sklearn")
    return True if from_sklearn else None


def setup(app):
    app.connect("autodoc-skip-member", leave_out_sklearn_members)
