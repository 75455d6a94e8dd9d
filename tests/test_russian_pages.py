"""The Russian pages: every chapter and every term, linked both ways, and marked as Russian."""

import re
import sys
from pathlib import Path

import nbformat
import pytest
import yaml

from tools import russian_glossary

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "book" / "extensions"))
from page_language import language, mark  # noqa: E402

RU = ROOT / "book" / "ru"
PAIRS = [
    (RU / "index.md", ROOT / "notebooks" / "index.ipynb"),
    (RU / "how_to_use.md", ROOT / "book" / "how_to_use.md"),
    (RU / "glossary.md", ROOT / "book" / "glossary.md"),
]


def targets(path):
    """The files that a page links to."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        cells = nbformat.reads(text, as_version=4).cells
        text = "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
    names = re.findall(r"\]\(([^)#\s]+)\)", text)
    return {(path.parent / name).resolve() for name in names if not name.startswith("http")}


@pytest.mark.parametrize(("russian", "english"), PAIRS, ids=lambda path: path.name)
def test_each_page_leads_to_the_other(russian, english):
    assert english in targets(russian)
    assert russian in targets(english)


def test_every_link_leads_somewhere():
    for path in RU.glob("*.md"):
        assert [target for target in targets(path) if not target.exists()] == []


def test_every_chapter_has_its_abstract_in_order():
    text = (RU / "index.md").read_text(encoding="utf-8")
    listed = re.findall(
        r"(?m)^\[(\d\d) .+?\]\(\.\./\.\./(notebooks/\d\d_\w+)\.ipynb\)\n: \S", text
    )
    contents = yaml.safe_load((ROOT / "_toc.yml").read_text())["parts"]
    files = [chapter["file"] for part in contents for chapter in part["chapters"]]
    lessons = [name for name in files if re.fullmatch(r"notebooks/\d\d_\w+", name)]
    assert [name for _, name in listed] == lessons
    assert all(name.startswith(f"notebooks/{number}_") for number, name in listed)


def test_the_russian_glossary_has_the_terms_of_the_english_one():
    text = (ROOT / "book" / "glossary.md").read_text(encoding="utf-8")
    assert (RU / "glossary.md").read_text(encoding="utf-8") == russian_glossary.page(text)
    count = int(re.search(r"There are (\d+) terms", text).group(1))
    assert len(russian_glossary.entries(text)) == count


def test_terms_are_in_the_order_of_the_russian_alphabet():
    text = "b\n  **ёж**. x\n\na\n  **ель** (P1). y\n\nc\n  **жук**. z\n"
    assert [russian for russian, _ in russian_glossary.entries(text)] == ["ёж", "ель", "жук"]


def test_a_russian_page_says_that_it_is_russian_and_no_other_does():
    assert (language("book/ru/index"), language("book/rules"), language("index")) == ("ru", "", "")
    context = {"body": "<p>привет</p>"}
    mark(None, "book/ru/index", "", context, None)
    assert context["body"] == '<div lang="ru"><p>привет</p></div>'
    mark(None, "book/errata", "", other := {"body": "<p>hello</p>"}, None)
    assert other == {"body": "<p>hello</p>"}


def test_no_latin_letter_hides_in_a_russian_word():
    mixed = re.compile(r"\w*(?:[а-яё][a-z]|[a-z][а-яё])\w*", re.IGNORECASE)
    for path in RU.glob("*.md"):
        assert mixed.findall(path.read_text(encoding="utf-8")) == []
    assert mixed.findall("кaрта") == ["кaрта"]
