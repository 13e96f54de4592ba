"""Formulas as MathML, which browsers draw without a script."""

from docutils import nodes
from latex2mathml.converter import convert


def _tex(node):
    return node.astext().strip()


def inline(self, node):
    """A formula in a line of text."""
    self.body.append(convert(_tex(node)))
    raise nodes.SkipNode


def block(self, node):
    """A formula on a line of its own."""
    self.body.append(self.starttag(node, "div", CLASS="math"))
    self.body.append(convert(_tex(node), display="block"))
    self.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app):
    """Register the renderer `mathml`."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
