"""How the site is built: `make docs`, without a network.

Pages are Markdown (MyST); the API comes from docstrings, the gallery from the programs in
examples/, and formulas become MathML, so that no page loads anything from elsewhere.
"""

from __future__ import annotations

import re
from importlib import metadata
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from latex2mathml.converter import convert
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.util.inspect import TypeAliasForwardRef
from typer.testing import CliRunner

from graspforce.cli import app as command

ROOT = Path(__file__).parents[1]

project = "graspforce"
author = "The graspforce developers"
copyright = author
release = version = metadata.version("graspforce")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "matplotlib.sphinxext.plot_directive",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["gallery/**/*.ipynb", "gallery/**/*.py", "gallery/**/*.md5"]
# Attributes of one name in two classes; no text refers to any of them by that name alone.
suppress_warnings = ["ref.python"]

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3

html_theme = "furo"
html_title = f"graspforce {release}"
html_copy_source = False
html_show_sphinx = False
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["site.css"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autodoc_class_signature = "mixed"
# In unions Sphinx leaves its stand-ins for aliases, by their repr.
TypeAliasForwardRef.__repr__ = lambda self: self.name
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "Array": "Array"}
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
napoleon_numpy_docstring = False
napoleon_use_ivar = True

plot_formats = [("svg", 100)]
plot_html_show_source_link = False
plot_html_show_formats = False
plot_include_source = False
plot_rcparams = {
    "figure.figsize": (6.4, 3.6),
    "font.size": 10,
    "figure.constrained_layout.use": True,
}

sphinx_gallery_conf = {
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "capture_repr": (),
    "abort_on_example_error": True,
    "reset_modules": ("matplotlib",),
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "remove_config_comments": True,
    "download_all_examples": False,
}


def visit_math(translator: Any, node: nodes.math | nodes.math_block) -> None:
    """Write a formula as MathML, which browsers draw by themselves."""
    if isinstance(node, nodes.math_block):
        formula = convert(node.astext(), display="block")
        translator.body.append(f'<div class="math">{formula}</div>')
    else:
        translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def escape_bars(*event: Any) -> None:
    """Keep the |x| of a docstring, outside of literals the name of a substitution."""
    lines: list[str] = event[-1]
    for i, line in enumerate(lines):
        lines[i] = re.sub(r"(``.*?``)|\|", lambda found: found[1] or r"\|", line)


def lead_to_the_page(app: Sphinx, doctree: nodes.document) -> None:
    """Let the search find the page for an index entry of its own, not the entry's place in it.

    That place is an empty element, of which the search has no text to show.
    """
    for index in doctree.findall(addnodes.index):
        index["entries"] = [
            (kind, value, "" if place.startswith("index-") else place, main, key)
            for kind, value, place, main, key in index["entries"]
        ]


class CommandHelp(Directive):
    """Show what ``graspforce NAME --help`` prints."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the help as a literal block."""
        words = [*self.arguments, "--help"]
        result = CliRunner().invoke(command, words, prog_name="graspforce", terminal_width=79)
        if result.exit_code:
            raise self.error(result.output)
        return [nodes.literal_block(text=result.output.strip(), language="text")]


def setup(app: Sphinx) -> None:
    """Add what this site has beyond its extensions."""
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_math, None))
    app.add_directive("command-help", CommandHelp)
    app.connect("doctree-read", lead_to_the_page)
    app.connect("autodoc-process-docstring", escape_bars)
