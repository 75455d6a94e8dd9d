"""The built book as its reader meets it: every page in a real browser, with no network.

Run `make book` first. Non-local requests are blocked and counted.
"""

import functools
import html.parser
import http.server
import os
import re
import shutil
import threading
import urllib.parse
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
HTML = ROOT / "_build" / "html"
CHROMIUM = os.environ.get("SLAMLAB_CHROMIUM") or shutil.which("chromium")
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run"]
PAGES = sorted(
    str(path.relative_to(HTML))
    for folder in ("book", "notebooks")
    for path in (HTML / folder).rglob("*.html")
)
PAGES += [page for page in ("search.html", "genindex.html") if (HTML / page).exists()]

pytestmark = [
    pytest.mark.book,
    pytest.mark.skipif(not PAGES, reason="the book is not built: run make book"),
]
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")

MARK_MORE_OF_THE_SAME = """
for (const kind of ['.highlight', 'mjx-container', 'dl.py > dd > dl.py, dl.field-list'])
    [...document.querySelectorAll(kind)].slice(8)
        .forEach(block => block.setAttribute('data-more-of-the-same', ''));
"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *args):
        pass


@pytest.fixture(scope="module")
def address():
    handler = functools.partial(Quiet, directory=str(HTML))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()


@pytest.fixture(scope="module")
def browser():
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def axe():
    import axe_playwright_python

    return (Path(axe_playwright_python.__file__).parent / "axe.min.js").read_text()


class Visit:
    """One page in one window, and whatever went wrong there."""

    def __init__(self, browser, address, page, width=1100, scheme="light"):
        self.troubles = []
        self.context = browser.new_context(
            viewport={"width": width, "height": 900},
            color_scheme=scheme,
            reduced_motion="no-preference",
        )
        self.tab = self.context.new_page()
        self.tab.on("console", self._console)
        self.tab.on("pageerror", lambda error: self.troubles.append(f"error: {error}"))
        self.tab.on("response", self._response)
        self.tab.route("**/*", functools.partial(self._route, address))
        self.tab.goto(address + page, wait_until="load")
        self.tab.wait_for_load_state("networkidle")
        self.settle()

    def _console(self, message):
        if message.type == "error":
            self.troubles.append(f"console: {message.text}")

    def _response(self, response):
        if response.status >= 400:
            self.troubles.append(f"{response.status}: {response.url}")

    def _route(self, address, route):
        url = route.request.url
        if url.startswith((address, "data:", "blob:")):
            route.continue_()
        else:
            self.troubles.append(f"asks the network: {url}")
            route.abort()

    def settle(self):
        """Wait until math and widgets are drawn."""
        if self.tab.query_selector(".math"):
            self.tab.wait_for_selector("mjx-container", state="attached", timeout=20_000)
        if self.tab.query_selector("script[type='application/vnd.jupyter.widget-view+json']"):
            self.tab.wait_for_selector(".slam-figure canvas", timeout=20_000)
            self.tab.wait_for_timeout(300)

    def violations(self, axe):
        self.tab.evaluate(axe)
        # Axe needs minutes for thousands of tokens and glyphs: eight blocks of each kind will do.
        self.tab.evaluate(MARK_MORE_OF_THE_SAME)
        found = self.tab.evaluate(
            # Without preload: axe would fetch imported styles by a path of its own.
            "axe.run({include: [['html']], exclude: [['[data-more-of-the-same]']]},"
            " {preload: false, resultTypes: ['violations']})"
            ".then(r => r.violations"
            ".filter(v => ['serious', 'critical'].includes(v.impact))"
            ".map(v => v.id + ': '"
            " + v.nodes.map(n => n.target.join(' ')).slice(0, 4).join(' | ')))"
        )
        return found

    def __enter__(self):
        return self

    def __exit__(self, *args):
        self.context.close()


CUT = """
[...document.querySelectorAll('article *')].filter(e => e.getClientRects().length
    && !e.closest('mjx-assistive-mml, mjx-ext') && (
    e.getBoundingClientRect().right > innerWidth + 2
    || (e.scrollWidth > e.clientWidth + 2 && e.clientWidth > 0
        && getComputedStyle(e).overflowX !== 'visible'))
).map(e => `${e.tagName} ${e.className}: ${e.textContent.slice(0, 60)}`).slice(0, 5)
"""
# Formulas whose first letters stand left of the page, where no finger can scroll to.
HEADLESS = """
[...document.querySelectorAll('article mjx-container[display="true"]')]
    .filter(e => e.getBoundingClientRect().left < 0)
    .map(e => e.textContent.slice(0, 60)).slice(0, 5)
"""
CHAPTERS = [page for page in PAGES if page.startswith("notebooks/") and page.count("/") == 1]


@needs_browser
@pytest.mark.parametrize("page", CHAPTERS)
def test_nothing_is_cut_on_paper(browser, address, page):
    with Visit(browser, address, page, width=720) as visit:  # A4 without its margins
        visit.tab.emulate_media(media="print")
        visit.tab.wait_for_timeout(300)
        assert visit.tab.evaluate(CUT) == []
        # What is folded leaves no bar behind, and what is there to be pressed is gone.
        assert not visit.tab.is_visible("article details.hide, article .copybtn")


@pytest.mark.parametrize("page", [page for page in PAGES if page.startswith("notebooks/")])
def test_a_chapter_offers_its_notebook_without_a_network(page):
    path = HTML / page
    (href,) = re.findall(r'download-notebook"><a href="([^"]+)"', path.read_text())
    assert (path.parent / href).resolve().suffix == ".ipynb"
    assert (path.parent / href).exists()


@needs_browser
@pytest.mark.parametrize("page", PAGES)
def test_a_page_opens_without_errors_requests_or_barriers(browser, address, axe, page):
    with Visit(browser, address, page) as visit:
        assert visit.violations(axe) == []
        assert visit.troubles == []


@needs_browser
@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_readable_in_the_dark_and_on_a_phone(browser, address, axe, page):
    with Visit(browser, address, page, width=360, scheme="dark") as visit:
        assert visit.tab.evaluate("document.documentElement.dataset.theme") == "dark"
        width = visit.tab.evaluate("document.scrollingElement.scrollWidth")
        assert width <= 360
        assert visit.tab.evaluate(HEADLESS) == []
        assert visit.violations(axe) == []
        assert visit.troubles == []


def pages_with(marker):
    return [page for page in PAGES if marker in (HTML / page).read_text()]


def line(figure):
    return figure.query_selector(".slam-text").inner_text()


# The simulator has no slider: test_simulator_browser.py drives it.
WIDGET_PAGES = [
    page
    for page in pages_with("application/vnd.jupyter.widget-view+json")
    if page != "notebooks/simulator.html"
]


@needs_browser
@pytest.mark.parametrize("page", WIDGET_PAGES)
def test_every_figure_moves_without_a_kernel(browser, address, page):
    with Visit(browser, address, page) as visit:
        figures = visit.tab.query_selector_all(".slam-figure")
        views = "script[type='application/vnd.jupyter.widget-view+json']"
        assert len(figures) == len(visit.tab.query_selector_all(views)) > 0
        for figure in figures:
            slider = figure.query_selector("input[type=range]")
            slider.scroll_into_view_if_needed()
            slider.focus()
            visit.tab.keyboard.press("Home")
            visit.tab.wait_for_timeout(80)
            first = line(figure)
            visit.tab.keyboard.press("End")
            visit.tab.wait_for_timeout(80)
            last = line(figure)
            assert first != last, "the keyboard moves nothing"
            box = slider.bounding_box()
            visit.tab.mouse.click(box["x"] + 0.4 * box["width"], box["y"] + box["height"] / 2)
            visit.tab.wait_for_timeout(80)
            middle = line(figure)
            assert middle not in (first, last), "the mouse moves nothing"
            canvas = figure.query_selector("canvas.slam-canvas")
            before = canvas.screenshot()
            visit.tab.keyboard.press("Home")
            visit.tab.wait_for_timeout(150)
            assert canvas.screenshot() != before, "the picture stands still"
            play = figure.query_selector("button[aria-label=Play]")
            if play is not None:
                start = line(figure)
                play.click()
                visit.tab.wait_for_timeout(600)
                pause = figure.query_selector("button[aria-label=Pause]")
                if pause is not None:  # three values have been played by now
                    pause.click()
                assert line(figure) != start, "it does not play"
        assert visit.troubles == []


class Links(html.parser.HTMLParser):
    """Targets and anchors of one page, and whatever it loads."""

    def __init__(self, text):
        super().__init__()
        self.hrefs, self.ids, self.loads = set(), set(), set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.ids |= {given[key] for key in ("id", "name") if given.get(key)}
        if tag == "a" and given.get("href"):
            self.hrefs.add(given["href"])
        if tag in {"script", "img", "iframe", "source"} and given.get("src"):
            self.loads.add(given["src"])
        if tag == "link" and given.get("rel") in {
            "stylesheet",
            "preload",
            "icon",
            "modulepreload",
        }:
            self.loads.add(given.get("href", ""))


@functools.cache
def links(path):
    return Links(path.read_text())


def dead_ends(path):
    found = []
    for href in sorted(links(path).hrefs):
        target, _, anchor = href.partition("#")
        if urllib.parse.urlsplit(href).scheme or target.startswith("//"):
            continue
        there = path if not target else (path.parent / urllib.parse.unquote(target)).resolve()
        if not there.exists():
            found.append(href)
        elif anchor and there.suffix == ".html":
            if urllib.parse.unquote(anchor) not in links(there).ids:
                found.append(href)
    return found


@pytest.mark.parametrize("page", PAGES)
def test_links_inside_the_book_lead_somewhere(page):
    assert dead_ends(HTML / page) == []


@pytest.mark.parametrize("page", PAGES)
def test_a_page_loads_local_files_only(page):
    path = HTML / page
    outside = [src for src in links(path).loads if urllib.parse.urlsplit(src).netloc]
    assert outside == []


def test_the_book_is_light():
    """Under 40 MB, as a disk counts them; no page over 1.5 MB, no source page with a sidebar."""
    files = [path for path in HTML.rglob("*") if path.is_file()]
    assert sum(-(-path.stat().st_size // 4096) * 4096 for path in files) < 40e6
    heavy = [path.name for path in HTML.rglob("*.html") if path.stat().st_size > 1.5e6]
    assert heavy == []
    sources = list((HTML / "_modules").rglob("*.html"))
    assert len(sources) > 50
    assert [path.name for path in sources if "bd-sidebar" in path.read_text()] == []


def test_the_link_check_sees_a_dead_end(tmp_path):
    page = tmp_path / "page.html"
    page.write_text(
        '<p id="here"><a href="#here">a</a><a href="#gone">b</a><a href="no.html">c</a>'
    )
    assert dead_ends(page) == ["#gone", "no.html"]
