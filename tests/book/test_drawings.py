"""Drawings: every word lies inside the picture, and no word lies on another."""

from pathlib import Path

import pytest

from tools.browser import CHROMIUM

ROOT = Path(__file__).resolve().parents[2]
DRAWINGS = sorted((ROOT / "book" / "static" / "drawings").rglob("*.svg"))
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")

FAULTS = """() => {
  const svg = document.querySelector("svg"), frame = svg.getBoundingClientRect();
  const words = [...svg.querySelectorAll("text")]
    .map(e => [e.textContent, e.getBoundingClientRect()]);
  const cut = words.filter(([, b]) => b.left < frame.left - 1 || b.right > frame.right + 1
    || b.top < frame.top - 1 || b.bottom > frame.bottom + 3).map(([t]) => "cut: " + t);
  const over = [];
  words.forEach(([t, a], i) => words.slice(i + 1).forEach(([u, b]) => {
    const w = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const h = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (w > 2 && h > 0.4 * Math.min(a.height, b.height)) over.push(`${t} on ${u}`);
  }));
  return [...cut, ...over];
}"""


@pytest.fixture(scope="module")
def tab():
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser.new_page(viewport={"width": 900, "height": 900})
        browser.close()


def faults(tab, text):
    tab.set_content(f"<body style='margin: 40px'>{text}</body>")
    return tab.evaluate(FAULTS)


@pytest.mark.parametrize("path", DRAWINGS, ids=lambda path: path.name)
def test_words_lie_inside_and_apart(tab, path):
    assert faults(tab, path.read_text()) == []


def test_a_word_that_is_cut_or_covered_is_found(tab):
    frame = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 40" width="100" height="40">'
    assert faults(tab, frame + '<text x="80" y="20">too long for it</text></svg>')
    assert faults(tab, frame + '<text x="5" y="20">one</text><text x="8" y="22">two</text></svg>')
    assert not faults(tab, frame + '<text x="5" y="20">one</text></svg>')
