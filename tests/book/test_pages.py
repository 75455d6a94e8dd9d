"""The built book as its reader meets it: every page in a real browser, with no network.

Run `make book` first. Non-local requests are blocked and counted. A page is opened once and looked
at by every check: as it opens, with its figures moved, in the dark on a phone, on paper.
"""

import functools
import html.parser
import re
import urllib.parse
from pathlib import Path

import pytest

from tools.browser import CHROMIUM, serving

ROOT = Path(__file__).resolve().parents[2]
HTML = ROOT / "_build" / "html"
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
]  # fmt: skip
PAGES = sorted(
    str(path.relative_to(HTML))
    for folder in ("book", "notebooks")
    for path in (HTML / folder).rglob("*.html")
)
OTHERS = ("search.html", "genindex.html", "_modules/index.html", "_modules/slamlab/geometry.html")
PAGES += [page for page in OTHERS if (HTML / page).exists()]

pytestmark = [
    pytest.mark.book,
    pytest.mark.skipif(not PAGES, reason="the book is not built: run make book"),
]
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")

# Axe needs minutes for thousands of tokens, glyphs and rows. Of blocks of one kind, and of words
# of code of one look, eight will do: the others are taken out while it runs, and put back.
# Contrast, its slowest rule, sees eight texts of each look: colours, size and weight of letters.
VIOLATIONS = """async () => {
  const out = [];
  const empty = (e) => { out.push([e, [...e.childNodes]]); e.replaceChildren(); };
  const same = ['.highlight', 'mjx-container', 'dl.py > dd > dl.py, dl.field-list',
    '.bd-sidebar-primary li:not(.current)'];
  same.flatMap(kind => [...document.querySelectorAll(kind)].slice(8)).forEach(empty);
  const text = e => [...e.childNodes].some(n => n.nodeType === 3 && n.data.trim());
  const grounds = new Map([[null, '']]);
  const ground = e => {
    if (!grounds.has(e)) {
      const {backgroundColor: color, backgroundImage: image, opacity} = getComputedStyle(e);
      const own = [color, image, opacity].join().replace('rgba(0, 0, 0, 0),none,1', '');
      const opaque = color.startsWith('rgb(') && opacity === '1';
      grounds.set(e, opaque ? own : own + ground(e.parentElement));
    }
    return grounds.get(e);
  };
  const look = e => {
    const {color, fontSize, fontWeight, textShadow} = getComputedStyle(e);
    return [color, fontSize, fontWeight, textShadow, ground(e)].join();
  };
  const seen = {};
  for (const e of document.body.querySelectorAll('*')) {
    if (!text(e) && !e.matches('input, select, textarea')) continue;
    const kind = look(e);
    seen[kind] = (seen[kind] ?? 0) + 1;
    if (seen[kind] <= 8) e.dataset.looked = '';
    else if (e.matches(':is(.highlight, .sig) span:not(:has(*))') && !e.closest('a')) empty(e);
  }
  axe.configure({rules: [{id: 'color-contrast', selector: '[data-looked]'}]});
  // Without preload: axe would fetch imported styles by a path of its own. Whatever breaks a rule
  // is as grave as the rule says: what is never serious is not looked for.
  const slight = axe._audit.rules.filter(rule => ['minor', 'moderate'].includes(rule.impact));
  const found = await axe.run({preload: false, resultTypes: ['violations'],
    rules: Object.fromEntries(slight.map(rule => [rule.id, {enabled: false}]))});
  document.querySelectorAll('[data-looked]').forEach(e => { delete e.dataset.looked; });
  out.reverse().forEach(([e, inside]) => e.replaceChildren(...inside));
  return found.violations.filter(v => ['serious', 'critical'].includes(v.impact))
    .map(v => v.id + ': ' + v.nodes.map(n => n.target.join(' ')).slice(0, 4).join(' | '));
}"""


@pytest.fixture(scope="module")
def address():
    with serving(HTML) as home:
        yield home


@pytest.fixture(scope="module")
def tab():
    """One tab for all pages: what they share is fetched and compiled once."""
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        tab = chromium.new_page(reduced_motion="no-preference")
        tab.set_default_timeout(120_000)
        yield tab
        chromium.close()


@pytest.fixture(scope="module")
def axe():
    import axe_playwright_python

    return (Path(axe_playwright_python.__file__).parent / "axe.min.js").read_text()


class Visit:
    """One page in the tab, opened at a width and in a theme, and whatever went wrong there."""

    def __init__(self, tab, address, page, width=1100, color_scheme="light"):
        self.troubles = []
        self.tab = tab
        self.listeners = {
            "console": self._console,
            "pageerror": lambda error: self.troubles.append(f"error: {error}"),
            "response": self._response,
            "request": functools.partial(self._request, address),
        }
        tab.goto("about:blank")  # what the last page still says is not this one's
        for event, listener in self.listeners.items():
            tab.on(event, listener)
        self._show(width, media="screen", color_scheme=color_scheme)
        tab.goto(address + page, wait_until="load")
        tab.wait_for_load_state("networkidle")
        self.settle()

    def _console(self, message):
        if message.type == "error":
            self.troubles.append(f"console: {message.text}")

    def _response(self, response):
        if response.status >= 400:
            self.troubles.append(f"{response.status}: {response.url}")

    def _request(self, address, request):
        if not request.url.startswith((address, "data:", "blob:")):
            self.troubles.append(f"asks the network: {request.url}")

    def settle(self):
        """Wait until math and widgets are drawn."""
        if self.tab.query_selector(".math"):
            self.tab.wait_for_selector("mjx-container", state="attached")
        if self.tab.query_selector("script[type='application/vnd.jupyter.widget-view+json']"):
            self.tab.wait_for_selector(".slam-figure canvas")
            self.tab.wait_for_timeout(300)

    def _show(self, width, **media):
        self.tab.emulate_media(**media)  # first: of another width alone the theme is told
        self.tab.set_viewport_size({"width": width, "height": 900})

    def turn(self, width, **media):
        """Give the open page another width, theme or medium."""
        self._show(width, **media)
        self.tab.evaluate(TURNED)
        if self.tab.query_selector('nav[aria-label="Book"]'):  # asks for the theme once
            self.tab.reload(wait_until="networkidle")
            self.settle()

    def violations(self, axe):
        if not self.tab.evaluate("'axe' in window"):
            self.tab.evaluate(axe)
        return self.tab.evaluate(VIOLATIONS)

    def unreadable_in_the_dark_on_a_phone(self, axe):
        """Say what is wrong with a page that is dark and 360 pixels wide."""
        dark = "document.documentElement.dataset.theme === 'dark'"
        self.tab.wait_for_function(dark)
        width = self.tab.evaluate("document.scrollingElement.scrollWidth")
        found = [] if width <= 360 else [f"{width} pixels wide"]
        found += self.tab.evaluate(HEADLESS) + self.tab.evaluate(CENTRED)
        return found + self.violations(axe)

    def cut_on_paper(self):
        """Name what leaves a sheet; what is folded or to be pressed is gone there."""
        pressed = self.tab.is_visible("article details.hide, article .copybtn")
        return self.tab.evaluate(CUT) + (["a bar or a button on paper"] if pressed else [])

    def __enter__(self):
        return self

    def __exit__(self, *args):
        for event, listener in self.listeners.items():
            self.tab.remove_listener(event, listener)


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
# Centred beside its number a formula would leave half of a phone empty.
CENTRED = """
[...document.querySelectorAll('article mjx-container[display="true"]:not([width="full"])')]
    .filter(e => e.getAttribute('justify') !== 'left')
    .map(e => 'centred: ' + e.textContent.slice(0, 60)).slice(0, 5)
"""
# The theme says which boxes scroll, and so take the keyboard, when a page of another width has
# not changed for 300 ms. Timers of the page itself are not overtaken by that one.
TURNED = """() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => {
    let timer = setTimeout(done, 350);
    new MutationObserver(() => { clearTimeout(timer); timer = setTimeout(done, 350); })
        .observe(document.body, {subtree: true, childList: true});
})))"""
PAPER = 700  # A4 without its margins has 720 pixels; the letters of another computer are wider
CHAPTERS = [page for page in PAGES if page.startswith("notebooks/") and page.count("/") == 1]


@pytest.mark.parametrize("page", [page for page in PAGES if page.startswith("notebooks/")])
def test_a_chapter_offers_its_notebook_without_a_network(page):
    path = HTML / page
    (href,) = re.findall(r'download-notebook"><a href="([^"]+)"', path.read_text())
    assert (path.parent / href).resolve().suffix == ".ipynb"
    assert (path.parent / href).exists()


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


def faults_of(tab, figure):
    """What of a figure does not move by keyboard, mouse or its button, without a kernel."""
    slider = figure.query_selector("input[type=range]")
    slider.scroll_into_view_if_needed()
    slider.focus()
    tab.keyboard.press("Home")
    tab.wait_for_timeout(80)
    first = line(figure)
    tab.keyboard.press("End")
    tab.wait_for_timeout(80)
    last = line(figure)
    found = [] if first != last else ["the keyboard moves nothing"]
    box = slider.bounding_box()
    tab.mouse.click(box["x"] + 0.4 * box["width"], box["y"] + box["height"] / 2)
    tab.wait_for_timeout(80)
    found += [] if line(figure) not in (first, last) else ["the mouse moves nothing"]
    canvas = figure.query_selector("canvas.slam-canvas")
    before = canvas.screenshot()
    tab.keyboard.press("Home")
    tab.wait_for_timeout(150)
    found += [] if canvas.screenshot() != before else ["the picture stands still"]
    play = figure.query_selector("button[aria-label=Play]")
    if play is not None:
        start = line(figure)
        play.click()
        tab.wait_for_timeout(600)
        pause = figure.query_selector("button[aria-label=Pause]")
        if pause is not None:  # three values have been played by now
            pause.click()
        found += [] if line(figure) != start else ["it does not play"]
    return found


def still_figures(tab):
    """Faults of all figures of a page; each view must have become one."""
    figures = tab.query_selector_all(".slam-figure")
    views = tab.query_selector_all("script[type='application/vnd.jupyter.widget-view+json']")
    found = [] if len(figures) == len(views) > 0 else ["a figure is missing"]
    return found + [fault for figure in figures for fault in faults_of(tab, figure)]


@needs_browser
@pytest.mark.parametrize("page", PAGES)
def test_a_page_has_no_errors_requests_or_barriers_and_can_be_read_everywhere(
    tab, address, axe, page
):
    with Visit(tab, address, page) as visit:
        found = {"as it opens": visit.violations(axe)}
        if page in WIDGET_PAGES:
            found["figures"] = still_figures(visit.tab)
        if page in CHAPTERS:
            visit.turn(PAPER, media="print")
            found["on paper"] = visit.cut_on_paper()
        visit.turn(360, media="screen", color_scheme="dark")
        found["in the dark on a phone"] = visit.unreadable_in_the_dark_on_a_phone(axe)
        found["errors and requests"] = visit.troubles
    assert {where: what for where, what in found.items() if what} == {}


OF_EACH_KIND = [
    "notebooks/index.html", "notebooks/07_walls_from_points.html", "search.html",
    "notebooks/exercises/02_kalman_filter.html", "book/api/slam.html", "book/league.html",
]  # fmt: skip


@needs_browser
@pytest.mark.parametrize("page", OF_EACH_KIND)
def test_a_page_that_opens_on_a_dark_phone_is_readable(tab, address, axe, page):
    with Visit(tab, address, page, 360, "dark") as visit:
        assert visit.unreadable_in_the_dark_on_a_phone(axe) == []
        assert visit.troubles == []


@needs_browser
@pytest.mark.parametrize("width", [390, 1100])
def test_in_the_dark_a_picture_keeps_the_shades_that_its_description_names(tab, address, width):
    page = "notebooks/exercises/08_occupancy_maps.html"
    with Visit(tab, address, page, width, "dark") as visit:
        filters = visit.tab.eval_on_selector_all(
            ".bd-article .cell_output img:not(.figure-panel *)",
            """e => e.flatMap(one => [one, ...one.closest('.cell_output').querySelectorAll(
                   '.figure-panel img')].map(
                       each => [one.alt.includes('white'), getComputedStyle(each).filter]))""",
        )
        assert {named for named, _ in filters} == {True, False}
        assert all(named != ("invert" in how) for named, how in filters)
        visit.tab.emulate_media(media="print")
        printed = visit.tab.eval_on_selector_all(
            ".bd-article .cell_output img", "e => e.map(one => getComputedStyle(one).filter)"
        )
        visit.tab.emulate_media(media="screen")
        assert set(printed) == {"none"}


@needs_browser
def test_on_a_phone_panels_and_cards_are_stacked_and_what_scrolls_fades_at_its_edge(tab, address):
    with Visit(tab, address, "notebooks/index.html", 390) as visit:
        cards = visit.tab.eval_on_selector_all(
            "td:has(a img)", "e => e.map(one => one.getBoundingClientRect().right)"
        )
        assert len(cards) > 20
        assert max(cards) <= 390
    with Visit(tab, address, "notebooks/exercises/09_ekf_slam.html", 390) as visit:
        assert len(visit.tab.query_selector_all(".figure-panels")) == 5
        panels = visit.tab.eval_on_selector_all(
            ".figure-panel", "e => e.map(one => one.getBoundingClientRect().toJSON())"
        )
        assert all(one["right"] <= 390 and one["height"] > 150 for one in panels)
        assert panels[1]["top"] >= panels[0]["bottom"]
        caption = visit.tab.locator(".panels-caption").first
        assert "mount" in caption.inner_text()
        assert caption.bounding_box()["y"] >= panels[1]["bottom"]
        visit.turn(1100)
        assert not caption.is_visible()
        assert not visit.tab.locator(".figure-panel").first.is_visible()
        assert visit.tab.locator(".figure-panels > *").first.is_visible()
    # No caption is torn: each stands below its panels, which keep one scale.
    with Visit(tab, address, "notebooks/exercises/11_data_association.html", 390) as visit:
        boxes = visit.tab.query_selector_all(".figure-panels")
        pictures = "img[alt^='Two ']:not(.figure-panel *)"
        assert len(boxes) == len(visit.tab.query_selector_all(pictures)) == 7
        for box in boxes:
            assert box.query_selector(".panels-caption")
            images = box.query_selector_all(".figure-panel img")
            left, right = (image.evaluate("e => e.offsetWidth") for image in images)
            assert abs(left - right) <= 1
    with Visit(tab, address, "book/league.html", 390) as visit:
        faded = "e => [e.scrollLeft = 1e6, e.classList.contains('goes-on')][1]"
        wide = visit.tab.locator(".table-scroll.goes-on").first
        assert wide.evaluate(faded)
        visit.tab.wait_for_timeout(100)
        assert visit.tab.locator(".table-scroll").first.evaluate(faded) is False


FAULTY = """<!doctype html><html lang="en"><head><title>Faulty</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>html[data-theme=dark] { background: #111 } html[data-theme=dark] p { color: #222 }
html[data-theme=dark] li { color: #fff }
html[data-theme=dark] li:nth-child(11) { color: #333 }</style>
<script>
const dark = matchMedia('(prefers-color-scheme: dark)');
dark.onchange = () => { document.documentElement.dataset.theme = dark.matches ? 'dark' : 'light'; }
setTimeout(() => { throw new Error('broken'); });
</script></head><body><main><h1>Faulty</h1><article>
<p>Grey on black at night.</p><img src="http://example.org/a.png"><img src="gone.png" alt="gone">
<div style="width: 900px; height: 9px"></div>BLOCKS</article></main></body></html>""".replace(
    "BLOCKS",
    '<div class="highlight">a <span>b</span></div>' * 10 + f"<ul>{'<li>Read me</li>' * 12}</ul>",
)


@needs_browser
def test_a_visit_sees_each_kind_of_fault(tab, axe, tmp_path):
    (tmp_path / "page.html").write_text(FAULTY)
    with serving(tmp_path) as home, Visit(tab, home, "page.html") as visit:
        whole = visit.tab.content()
        (missing,) = visit.violations(axe)
        assert missing.startswith("image-alt: ")
        assert visit.tab.content() == whole
        visit.turn(360, color_scheme="dark")
        found = " ".join(visit.unreadable_in_the_dark_on_a_phone(axe))
        assert "pixels wide" in found
        assert "color-contrast: " in found
        assert "li:nth-child(11)" in found  # one of many alike that is not
        visit.turn(PAPER, color_scheme="light", media="print")
        assert visit.cut_on_paper()[0].startswith("DIV")
        troubles = " ".join(visit.troubles)
    for fault in ("error: broken", "asks the network: http://example.org/a.png", "404: "):
        assert fault in troubles


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
    """Under 72 MB, as a disk counts them; no page over 1.5 MB, no source page with a sidebar."""
    files = [path for path in HTML.rglob("*") if path.is_file()]
    # A lesson and its second page take some 0.3 MB more than one long chapter did;
    # with 17 further pages the book had 48.0 MB, with 22 it had 51.8, with 25 54.6; with 10c, 10d,
    # 12c and 16e it had 56.7. Every exercise has a picture now, on both of its pages: 67.9.
    assert sum(-(-path.stat().st_size // 4096) * 4096 for path in files) < 72e6
    heavy = [path.name for path in HTML.rglob("*.html") if path.stat().st_size > 1.5e6]
    assert heavy == []
    # Every page loads the icons: only those that it shows.
    assert (HTML / "_static" / "scripts" / "fontawesome.js").stat().st_size < 2e5
    sources = list((HTML / "_modules").rglob("*.html"))
    assert len(sources) > 50
    assert [path.name for path in sources if "bd-sidebar" in path.read_text()] == []


def test_the_link_check_sees_a_dead_end(tmp_path):
    page = tmp_path / "page.html"
    page.write_text(
        '<p id="here"><a href="#here">a</a><a href="#gone">b</a><a href="no.html">c</a>'
    )
    assert dead_ends(page) == ["#gone", "no.html"]
