"""`make pdf`: numbered sheets, contents that name the right one, links that stay inside."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from tools.browser import CHROMIUM

ROOT = Path(__file__).resolve().parents[2]
HTML = ROOT / "_build" / "html"
PAGES = ["book/conventions", "book/glossary"]

pytestmark = [
    pytest.mark.book,
    pytest.mark.skipif(not HTML.exists(), reason="the book is not built: run make book"),
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed"),
]


def pdf_tool():
    spec = importlib.util.spec_from_file_location("pdf_tool", ROOT / "tools" / "pdf.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["pdf_tool"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def book(tmp_path_factory):
    pypdf = pytest.importorskip("pypdf")
    path = tmp_path_factory.mktemp("pdf") / "two.pdf"
    tool = ROOT / "tools" / "pdf.py"
    subprocess.run([sys.executable, tool, *PAGES, "-o", path], check=True, cwd=ROOT, timeout=120)
    return pypdf.PdfReader(path)


def test_the_contents_name_the_sheet_on_which_a_page_begins(book):
    words = book.pages[0].extract_text()
    begins = {
        entry.title: book.get_destination_page_number(entry)
        for part in book.outline
        if isinstance(part, list)
        for entry in part
    }
    assert len(begins) == len(PAGES)
    for title, sheet in begins.items():
        line = next(line for line in words.splitlines() if line.startswith(title))
        assert line.split()[-1] == str(sheet + 1) or f"{title}\n{sheet + 1}" in words
        assert title in book.pages[sheet].extract_text()


def test_every_sheet_has_its_number(book):
    for k, sheet in enumerate(book.pages):
        assert str(k + 1) in sheet.extract_text().split()[-3:] + sheet.extract_text().split()[:3]


def test_no_link_leads_to_the_server_that_printed_it(book):
    for sheet in book.pages:
        for entry in sheet.get("/Annots") or ():
            action = entry.get_object().get("/A")
            assert "127.0.0.1" not in str(action and action.get_object().get("/URI", ""))


def test_solutions_and_api_are_left_out():
    names = [name for _, name in pdf_tool().pages_of(ROOT / "_toc.yml", ["*"])]
    chapter = names.index("notebooks/02_kalman_filter")
    assert names[chapter + 1] == "notebooks/02b_kalman_filter"
    assert names[chapter + 2] == "notebooks/exercises/02_kalman_filter"
    assert not [name for name in names if "solutions" in name or name.startswith("book/api")]
