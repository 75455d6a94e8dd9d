"""Formulas that carry a tag: Sphinx would put them into a `split`, where MathJax allows none."""

from docutils import nodes
from sphinx.application import Sphinx


def keep_tags(app: Sphinx, doctree: nodes.document) -> None:
    """Write tagged display formulas as they are, between the brackets of display mathematics."""
    for node in doctree.findall(nodes.math_block):
        text = node.astext()
        if r"\tag{" in text and not node.get("no-wrap", node.get("nowrap")):
            node["nowrap"] = node["no-wrap"] = True
            node.children = [nodes.Text(rf"\[{text}\]")]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("doctree-read", keep_tags)
    return {"parallel_read_safe": True}
