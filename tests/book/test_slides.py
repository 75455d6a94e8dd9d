"""Decks of slides: one for every lesson, with algorithm and figures, without a network."""

import re

import nbformat
import pytest

from tests.book.test_pages import FLAGS
from tools import slides
from tools.browser import CHROMIUM, serving

pytestmark = [
    pytest.mark.book,
    pytest.mark.skipif(not slides.CACHE.exists(), reason="the book is not built: run make book"),
]
V4 = nbformat.v4


def decks(folder, *chapters):
    assert slides.main(list(chapters), folder) == 0
    return {path.stem[:2]: path for path in sorted(folder.glob("*.html"))}


def test_every_lesson_has_a_deck_with_figures_and_no_address_of_the_network(tmp_path):
    found = decks(tmp_path)
    assert list(found) == [path.name[:2] for path in slides.lessons([])]
    for chapter, path in found.items():
        text = path.read_text()
        assert text.count("data:image/") >= 2, chapter
        assert re.findall(r'(?:src|import|url\()[="\' ]*https?://', text) == [], chapter
        assert text.count("<section") > 10, chapter


def test_the_algorithm_is_shown_and_the_prose_is_in_the_notes(tmp_path):
    text = decks(tmp_path, "09")["09"].read_text()
    shown, notes = re.sub(r'(?s)<aside class="notes">.*?</aside>', "", text), text
    code = re.sub(r"<[^>]+>", "", shown)
    assert "def predict(X, P, u, dt, V):" in code
    assert "To place them the robot must know its pose" not in re.sub(r"\s+", " ", shown)
    assert "must know its pose" in re.sub(r"\s+", " ", notes)


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
@pytest.mark.parametrize("chapter", ["02", "09"])
def test_a_deck_runs_in_a_browser_without_a_network(tmp_path, chapter):
    sync_api = pytest.importorskip("playwright.sync_api")
    deck = decks(tmp_path, chapter)[chapter]
    troubles = []
    with serving(tmp_path) as home, sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        tab = chromium.new_page(viewport={"width": 1200, "height": 800})
        tab.on("pageerror", lambda error: troubles.append(str(error)))
        tab.on(
            "request",
            lambda request: (
                request.url.startswith((home, "data:", "blob:")) or troubles.append(request.url)
            ),
        )
        tab.goto(home + deck.name, wait_until="networkidle")
        tab.wait_for_selector("mjx-container", state="attached")
        for _ in range(tab.evaluate("Reveal.getTotalSlides()") - 1):
            tab.evaluate("Reveal.next()")
        assert tab.evaluate("Reveal.isLastSlide()")
        chromium.close()
    assert troubles == []


def test_a_text_keeps_its_heading_first_sentence_formulas_and_lists():
    text = (
        "## Gain\n\nOne. Two.\n\n$$ K $$\n\nThree.\n\n- a\n- b\n\n**Bold** is kept. This not.\n\n"
    )
    hidden = text + "<details><summary>The answer</summary>\n\nForty-two.\n\n</details>"
    assert slides.shown(hidden) == "## Gain\n\nOne.\n\n$$ K $$\n\n- a\n- b\n\n**Bold** is kept."


def test_what_a_cell_shows_depends_on_its_tags():
    figure = V4.new_output("display_data", {"image/png": "aGVsbG8=", "text/plain": "<Figure>"})
    widget = V4.new_output("display_data", {"application/vnd.jupyter.widget-view+json": {}})

    def kinds(*tags, source="x = 1", outputs=(figure,)):
        cell = V4.new_code_cell(source, outputs=list(outputs), metadata={"tags": list(tags)})
        return [
            ("no-input" in one.metadata.get("tags", []), len(one.outputs))
            for one in slides.of_code(cell)
        ]

    assert kinds("algorithm", source="x\n" * 40) == [(False, 0), (True, 1)]
    assert kinds("hide-input") == [(True, 1)]
    assert kinds(source="x\n" * 40) == [(True, 1)]
    assert kinds("hide-input", outputs=[widget]) == []  # a figure that moves is on the page
    printed = V4.new_output("stream", text="4.7 m")
    assert kinds(outputs=[printed]) == [(False, 1)]
    assert kinds("hide-output", outputs=[printed]) == [(False, 0), (True, 1)]


def test_a_lesson_that_was_not_run_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(slides, "CACHE", tmp_path / "cache")
    assert slides.main(["09"], tmp_path / "slides") == 1
    assert "09_ekf_slam.ipynb" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="expected numbers of chapters, got 99"):
        slides.main(["99"], tmp_path / "slides")
