"""The pages of deltalux: made from the docstrings, without warnings.

sphinx-build -W --keep-going -b html python/docs python/docs/build
"""

import os
import subprocess
import sys
from pathlib import Path

import deltalux
from docutils import nodes
from sphinx.util.docutils import SphinxDirective

project = "deltalux"
copyright = "the deltalux authors"
release = version = deltalux.__version__
exclude_patterns = ["build"]
html_theme = "alabaster"
html_theme_options = {
    "description": deltalux.__doc__.splitlines()[0].removeprefix("deltalux: "),
    "page_width": "1100px",
}

extensions = ["sphinx.ext.autodoc", "numpydoc"]
# No page needs PyTorch to be there.
autodoc_mock_imports = ["torch"]
autodoc_member_order = "bysource"
# Signatures say the types, in the words of the source.
autodoc_typehints = "signature"
autodoc_use_legacy_class_based = False
default_role = "py:obj"
# Every class has a page of its own, with its methods in full.
numpydoc_show_class_members = False
numpydoc_validation_checks = set()

ROOT = Path(__file__).parents[2]


class Printed(SphinxDirective):
    """``.. printed:: python -m deltalux --help``: what a command prints, so that no page can be older than the code."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        python, *arguments = self.arguments[0].split()
        assert python == "python", "only our own commands are run"
        done = subprocess.run(
            [sys.executable, *arguments], cwd=ROOT, env={**os.environ, "COLUMNS": "100"}, capture_output=True, text=True
        )
        if done.returncode:
            raise self.error(f"{self.arguments[0]} failed: {done.stderr}")
        return [nodes.literal_block(done.stdout, done.stdout, language="text")]


def setup(app):
    app.add_directive("printed", Printed)
