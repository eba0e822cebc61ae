"""Sphinx configuration; build with `sphinx-build -W -b html docs docs/_build/html`.

The build needs no network, and neither does what it builds: equations are set by the MathJax in
_static/mathjax (tex-svg.js of npm's mathjax 3.2.2, one file with its fonts: 2.1 MB, 0.7 MB
compressed, loaded by pages that have equations), and links to other projects come from
_inventories, which tools/inventories.py writes.
"""

import sys
from pathlib import Path

from sphinx.ext import autosummary

import skhoid

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "tools")]  # effect_cards, gallery_pages, inventories
import gallery_pages  # noqa: E402
from inventories import SITES  # noqa: E402

project = "skhoid"
author = "skhoid developers"
copyright = "2026, skhoid developers"
version = release = skhoid.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
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
html_favicon = "_static/favicon.svg"
html_title = f"skhoid {release}"
html_show_sourcelink = False
html_context = {"default_mode": "auto"}  # light or dark as the reader has it
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["labels.js", "filter.js"]
html_sidebars = {"index": [], "api": [], "generated/**": []}  # a list of 170 names helps nobody
html_theme_options = {
    "logo": {
        "image_light": "_static/logo.svg",
        "image_dark": "_static/logo-dark.svg",
        "text": "skhoid",
        "alt_text": "skhoid: start page",
    },
    "header_links_before_dropdown": 7,  # the sections, all in sight
    "navbar_persistent": ["search-button"],
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "footer_start": ["copyright"],
    "footer_end": [],
}

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

mathjax_path = "mathjax/tex-svg.js"
mathjax3_config = {"options": {"enableMenu": False}}  # the menu would load parts that are not here
intersphinx_mapping = {
    project: (site, f"_inventories/{project}.inv") for project, site in SITES.items()
}

toc_object_entries_show_parents = "hide"  # fit(), not ARXRegressor.fit()
autosummary_generate = True
# A summary is a docstring's first sentence, which "(Eq. 5)" does not end.
autosummary.WELL_KNOWN_ABBREVIATIONS += ("App.", "Eq.", "Eqs.", "Fig.", "Figs.", "Sec.")
autodoc_typehints = "none"  # numpydoc's Parameters section gives the types
numpydoc_show_class_members = False  # the autosummary template lists them
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"  # but for these, and numpydoc's own list
numpydoc_xref_aliases = {
    **{name: f"skhoid.{name}" for name in skhoid.__all__ if name[0].isupper()},
    "Effect": "skhoid.effects.Effect",
    "Effects": "skhoid.effects.Effects",
    "Path": "pathlib.Path",
    "DataFrame": "pandas.DataFrame",
    "Series": "pandas.Series",
    "Axes": "matplotlib.axes.Axes",
    "Figure": "matplotlib.figure.Figure",
    "Generator": "numpy.random.Generator",
}

copybutton_exclude = ".linenos, .gp, .go"

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/plot_",
    "doc_module": ("skhoid",),
    "backreferences_dir": "generated/backreferences",
    "image_scrapers": ("gallery_pages.pictures",),
    "thumbnail_size": (640, 448),
    "image_srcset": ["2x"],  # sharp on the screens of today
    "subsection_order": [
        f"../examples/{topic}"
        for topic in (
            "diagnosis",
            "identify",
            "preprocess",
            "recursion",
            "simulate",
            "montecarlo",
            "experiment",
            "frequency",
        )
    ],
    "within_subsection_order": "gallery_pages.PageOrder",
    "remove_config_comments": True,
    "download_all_examples": False,
    "show_signature": False,
    "parallel": 2,
}


# What EffectSearchCV calls on the estimators that it searches with, and nobody else: their pages
# leave it out, and effect-in-depth.md tells those who write an estimator of their own.
CALLED_BY_SEARCHES = ("prepare", "first_fit", "with_fit", "free_run")


def leave_out_members(app, what, name, obj, skip, options):
    """Skip what scikit-learn's base classes bring along (its pages document it), and plumbing."""
    module = getattr(obj, "__module__", None) or ""
    plumbing = name in CALLED_BY_SEARCHES and module.startswith("skhoid.model")
    return True if plumbing or module.startswith("sklearn") else None


def plain_terms(app, what, name, obj, options, lines):
    """Take links to scikit-learn's own glossary out of what is inherited from it."""
    lines[:] = [line.replace(":term:`fit`", "``fit``") for line in lines]


def setup(app):
    app.connect("autodoc-skip-member", leave_out_members)
    app.connect("autodoc-process-docstring", plain_terms, priority=900)  # after numpydoc
    app.connect("builder-inited", gallery_pages.show_panels, priority=900)  # after the gallery
    app.connect("doctree-read", gallery_pages.show_sharp, priority=400)  # before copies are made
