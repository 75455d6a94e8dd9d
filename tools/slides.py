"""Make a deck of slides of a lesson: `make slides CH=09`, after `make book`.

    python tools/slides.py           every lesson
    python tools/slides.py 09 12     these

The deck is made of the lesson and of what its run showed (from the book's cache). A heading begins
a slide; the algorithm stands on slides of its own with its code, a figure on one without; of the
prose, the first sentence of a section, its formulas and its lists are shown, and all of it is in
the speaker's notes (key S). A cell tagged `slide` is shown whole, one tagged `no-slide` not at
all. Where the lesson folds an answer away, it comes on a slide after the question.

Keys: arrows, F for the whole screen, S for the notes, `?print-pdf` behind the address for paper.
"""

from __future__ import annotations

import base64
import copy
import mimetypes
import re
import shutil
import sys
from pathlib import Path

import nbformat
from jupyter_cache import get_cache
from nbconvert import SlidesExporter
from traitlets.config import Config

ROOT = Path(__file__).resolve().parents[1]
VENDOR = ROOT / "book" / "static" / "vendor"
TEMPLATES = ROOT / "tools" / "templates"
DECKS = ROOT / "_build" / "slides"
CACHE = ROOT / "_build" / ".jupyter_cache"
LONG = 14  # lines of code; what is longer and no algorithm shows its result only
_SENTENCE = re.compile(r"(?s)^.*?(?<!al)[.?!](?=\s+[A-Z*]|$)")
SHORT = 300  # letters; what comes after so short a text stands on its slide
_KEPT = re.compile(r"\s*([-*] |\d+\. |\||\$\$|!\[|#)")

Cell = nbformat.NotebookNode


def lessons(chapters: list[str]) -> list[Path]:
    """Return the lessons of some chapters, or of all."""
    paths = sorted((ROOT / "notebooks").glob("[0-9][0-9]_*.ipynb"))
    return [path for path in paths if not chapters or path.name[:2] in chapters]


def blocks(text: str) -> list[str]:
    """Split a text into its paragraphs; a display formula is one."""
    found = re.split(r"(?ms)(^\$\$.*?\$\$[^\n]*$)", text)
    return [
        part.strip()
        for piece in found
        for part in ([piece] if piece.startswith("$$") else re.split(r"\n\s*\n", piece))
        if part.strip()
    ]


def shown(text: str) -> str:
    """Return what a slide shows of a text: headings, formulas, lists, and one sentence."""
    kept, said = [], not text.startswith("#")
    for block in blocks(re.sub(r"(?ms)^> ?", "", text)):
        if block.startswith("<details"):
            break
        if _KEPT.match(block):
            kept.append(block)
        elif not said or block.startswith("**"):
            found = _SENTENCE.match(block)
            kept.append(found[0] if found else block)
            said = True
    return "\n\n".join(kept)


def slide(cell: Cell, kind: str) -> Cell:
    """Return the cell as a slide, a slide below it, a part of one, or notes."""
    cell.metadata["slideshow"] = {"slide_type": kind}
    return cell


def of_text(cell: Cell) -> list[Cell]:
    """Return the slides of a text: a heading begins one, all of the prose goes into the notes."""
    parts = re.split(r"(?m)^(?=#{1,2} )", cell.source)
    found = []
    for part in filter(str.strip, parts):
        text = part if "slide" in cell.metadata.get("tags", []) else shown(part)
        kind = "slide" if part.startswith("#") else "-"
        if text.strip():
            found.append(slide(nbformat.v4.new_markdown_cell(text), kind))
        if text.strip() != part.strip():
            found.append(slide(nbformat.v4.new_markdown_cell(part), "notes"))
    return found


def of_code(cell: Cell) -> list[Cell]:
    """Return the slides of a code cell: its code if it is the algorithm or short, its results."""
    tags = set(cell.metadata.get("tags", []))
    short = len(cell.source.splitlines()) <= LONG and "hide-input" not in tags
    with_code = bool(tags & {"algorithm", "slide"}) or short
    results = [one for one in map(still, cell.outputs) if one is not None]
    figures = [one for one in results if one.output_type != "stream"]
    code, result = copy.deepcopy(cell), copy.deepcopy(cell)
    code.outputs, result.outputs = [], results
    result.metadata["tags"], result.id = ["no-input"], f"{cell.id}-result"
    if not with_code:
        return [slide(result, "subslide")] if results else []
    if results and (figures or "hide-output" in tags):
        return [slide(code, "subslide"), slide(result, "subslide")]
    code.outputs = results
    return [slide(code, "subslide")]


def still(output: Cell) -> Cell | None:
    """Return an output without what needs a script; None if nothing is left."""
    output = copy.deepcopy(output)
    if "data" in output:
        if any("widget" in kind for kind in output.data):
            return None
        output.data.pop("application/javascript", None)
    return output


def deck(notebook: Cell) -> Cell:
    """Return the notebook of the slides of a lesson that was run."""
    cells = []
    for cell in notebook.cells:
        if "no-slide" not in cell.metadata.get("tags", []):
            cells += of_text(cell) if cell.cell_type == "markdown" else of_code(cell)
    above: Cell | None = None
    for cell in cells:
        kind = cell.metadata["slideshow"]["slide_type"]
        if kind == "subslide" and above is not None and len(above.source) < SHORT:
            slide(cell, "-")
        if kind != "notes":
            above = cell if kind == "slide" and "$$" not in cell.source else None
    return nbformat.v4.new_notebook(cells=cells, metadata=notebook.metadata)


def page(notebook: Cell, title: str) -> str:
    """Return the deck as a page that finds its files in `vendor` beside it."""
    config = Config()
    config.TagRemovePreprocessor.enabled = True
    config.TagRemovePreprocessor.remove_input_tags = {"no-input"}
    exporter = SlidesExporter(
        config=config,
        extra_template_basedirs=[str(TEMPLATES)],
        template_name="slides",
        reveal_url_prefix="vendor/reveal",
        reveal_theme="white",
        mathjax_url="vendor/mathjax/tex-mml-chtml.js",
        exclude_input_prompt=True,
        exclude_output_prompt=True,
    )
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = re.sub(r"(!\[[^]]*\]\()(\.\./[^)]+)(\))", _embedded, cell.source)
            cell.source = re.sub(r"\]\((?!data:|http|#)([^)#]+)\.(?:ipynb|md)", _page, cell.source)
    body, _ = exporter.from_notebook_node(notebook, {"metadata": {"name": title}})
    return body


def _page(link: re.Match[str]) -> str:
    """Return a link to the page of the book, which lies beside the decks."""
    folder = "" if link[1].startswith("../") else "notebooks/"
    return f"](../html/{folder}{link[1].removeprefix('../')}.html"


def _embedded(image: re.Match[str]) -> str:
    """Return a picture of a text with its file in it."""
    path = ROOT / "notebooks" / image[2]
    kind = mimetypes.guess_type(path.name)[0]
    return f"{image[1]}data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}{image[3]}"


def main(words: list[str], decks: Path = DECKS) -> int:
    """Write the decks; 1 if a lesson is not in the book's cache."""
    paths = lessons(words)
    if not paths:
        raise SystemExit(f"slides: expected numbers of chapters, got {' '.join(words)}")
    cache = get_cache(str(CACHE))
    decks.mkdir(parents=True, exist_ok=True)
    for source in (TEMPLATES / "slides" / "reveal", VENDOR / "mathjax"):
        shutil.copytree(source, decks / "vendor" / source.name, dirs_exist_ok=True)
    missing = []
    for path in paths:
        stored = nbformat.read(path, as_version=4)
        try:
            _, run = cache.merge_match_into_notebook(stored)
        except KeyError:
            missing.append(path.name)
            continue
        title = next(re.findall(r"(?m)^# (.*)", cell.source)[0] for cell in run.cells)
        (decks / f"{path.stem}.html").write_text(page(deck(run), title), encoding="utf-8")
        print(decks / f"{path.stem}.html")
    if missing:
        print(f"not in the book's cache, run make book: {', '.join(missing)}", file=sys.stderr)
    return int(bool(missing))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
