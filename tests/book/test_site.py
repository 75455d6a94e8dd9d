"""`make site`: a folder for any host, under any path; pointing somewhere only if told to."""

import json
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml

from tools import site as tool
from tools.browser import CHROMIUM, serving

ROOT = Path(__file__).resolve().parents[2]
URL = "https://someone.github.io/slam/"
SCHEMA = "{http://www.sitemaps.org/schemas/sitemap/0.9}"
PAGE = """<html><head><title>The A &amp; B</title>
<meta name="description" content="A robot drives &quot;off&quot;.">
</head><body><div class="onlyprint"><h1>The A</h1></div>
<article class="bd-article"><h1>The A</h1><p>x</p></article></body></html>"""
NAME = "notebooks/01_bayes_filter"


@pytest.fixture
def html(tmp_path):
    """Three pages as the builder leaves them."""
    folder = tmp_path / "html"
    for name in (f"{NAME}.html", "book/glossary.html", "_modules/a.html"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(PAGE)
    (folder / "search.html").write_text(PAGE)
    leading = f'<meta http-equiv="Refresh" content="0; url={NAME}.html" />'
    (folder / "index.html").write_text(leading)
    return folder


def test_without_an_address_no_page_is_changed(html, tmp_path):
    tool.make_site(html, tmp_path / "site")
    for path in html.rglob("*.html"):
        assert (tmp_path / "site" / path.relative_to(html)).read_bytes() == path.read_bytes()
    assert not (tmp_path / "site" / "sitemap.xml").exists()
    assert not (tmp_path / "site" / "robots.txt").exists()


def test_with_an_address_pages_say_where_they_are_and_have_a_card(html, tmp_path):
    tool.make_site(html, tmp_path / "site", URL)
    text = (tmp_path / "site" / "book/glossary.html").read_text()
    assert f'<link rel="canonical" href="{URL}book/glossary.html">' in text
    assert '<meta property="og:title" content="The A &amp; B">' in text
    assert 'og:description" content="A robot drives &quot;off&quot;."' in text
    picture = re.search(r'og:image" content="([^"]+)"', text).group(1)
    assert (ROOT / "book/static" / picture.removeprefix(f"{URL}_static/")).exists()
    assert "colab" not in text
    first = (tmp_path / "site" / "index.html").read_text()
    assert f'url={NAME}.html"' in first
    assert f'<link rel="canonical" href="{URL}{NAME}.html">' in first


def test_the_sitemap_lists_the_pages_that_one_reads(html, tmp_path):
    tool.make_site(html, tmp_path / "site", URL)
    listed = ElementTree.parse(tmp_path / "site" / "sitemap.xml").iter(f"{SCHEMA}loc")
    assert [each.text for each in listed] == [f"{URL}book/glossary.html", f"{URL}{NAME}.html"]
    assert f"{URL}sitemap.xml" in (tmp_path / "site" / "robots.txt").read_text()


def test_pages_of_notebooks_have_buttons_and_others_have_none(html, tmp_path):
    tool.make_site(html, tmp_path / "site", URL, "someone/slam")
    text = (tmp_path / "site" / f"{NAME}.html").read_text()
    assert f"colab.research.google.com/github/someone/slam/blob/online/{NAME}.ipynb" in text
    assert "mybinder.org/v2/gh/someone/slam/online?labpath=notebooks%2F01_bayes" in text
    assert "run-online" in text.partition("<article")[2]
    assert "run-online" not in text.partition("<article")[0]
    assert "run-online" not in (tmp_path / "site" / "book/glossary.html").read_text()


def test_an_online_notebook_installs_what_is_missing_and_is_else_the_same(tmp_path, capsys):
    count = tool.make_online(tmp_path / "online", "someone/slam")
    assert count == len(list((tmp_path / "online").rglob("*.ipynb"))) > 60
    theirs = json.loads((tmp_path / "online" / f"{NAME}.ipynb").read_text())
    ours = json.loads((ROOT / f"{NAME}.ipynb").read_text())
    first, *rest = theirs["cells"]
    assert rest == ours["cells"]
    asked = []
    code = re.sub(r"%pip (.*)", r"asked.append(r'\1')", "".join(first["source"]))
    exec(code, {"asked": asked})
    assert asked == []  # here it is installed
    exec(code.replace('"slamlab"', '"slamlab_that_is_missing"'), {"asked": asked})
    assert asked == ['install -q "slamlab-course[course] @ git+https://github.com/someone/slam"']


@pytest.mark.parametrize(
    ("url", "named", "found"),
    [
        (URL, "", "someone/slam"),
        ("https://example.org/slam/", "", ""),
        ("https://example.org/slam/", "a/b", "a/b"),
    ],
)
def test_the_repository_is_named_or_follows_from_the_address(url, named, found):
    assert tool.repository(url, named) == found


@pytest.mark.parametrize("wrong", ["example.org/slam", "ftp://example.org/", "https://a/?b=c"])
def test_what_is_no_address_is_refused(wrong):
    with pytest.raises(SystemExit, match="BOOK_URL: expected an address"):
        tool.address(wrong)
    assert tool.address("https://example.org/slam") == "https://example.org/slam/"
    assert tool.address("") == ""


# A book of a few pages, built as the whole one is, and walked in a browser under a sub-path.


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A built book of pages without notebooks."""
    pytest.importorskip("jupyter_book")
    folder = tmp_path_factory.mktemp("small")
    shutil.copytree(ROOT / "book", folder / "book")
    shutil.copy(ROOT / "_config.yml", folder)
    pages = ["book/glossary", "book/conventions", "book/bibliography"]
    pages += [f"book/ru/{path.stem}" for path in sorted((ROOT / "book/ru").glob("*.md"))]
    toc = {
        "format": "jb-book",
        "root": "book/how_to_use",
        "chapters": [{"file": page} for page in pages],
    }
    (folder / "_toc.yml").write_text(yaml.safe_dump(toc))
    words = [Path(sys.executable).with_name("jupyter-book"), "build", ".", "-q"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return folder / "_build" / "html", ["book/how_to_use", *pages]


@pytest.mark.book
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_every_link_and_file_is_found_under_a_sub_path(small, tmp_path):
    sync_api = pytest.importorskip("playwright.sync_api")
    html, names = small
    only_here = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
    flags = ["--no-sandbox", "--disable-gpu", only_here]
    asked, lost = set(), []
    with serving(tmp_path) as home, sync_api.sync_playwright() as playwright:
        tool.make_site(html, tmp_path / "slam", f"{home}slam/")
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
        tab = chromium.new_page()
        tab.on("request", lambda request: asked.add(request.url))
        tab.on("response", lambda r: lost.append(r.url) if r.status >= 400 else None)
        tab.goto(f"{home}slam/")
        tab.wait_for_url("**/how_to_use.html")
        links = set()
        for name in names:
            tab.goto(f"{home}slam/{name}.html", wait_until="networkidle")
            assert tab.locator("article h1").count() == 1
            canonical = tab.locator('link[rel="canonical"]').get_attribute("href")
            assert canonical == f"{home}slam/{name}.html"
            links |= set(tab.eval_on_selector_all("a[href]", "all => all.map(a => a.href)"))
        chromium.close()
    assert lost == []
    web = {url for url in asked if url.startswith("http")}
    assert {url for url in web if not url.startswith(f"{home}slam/")} == set()
    inside = {url.partition("#")[0].partition("?")[0] for url in links if url.startswith(home)}
    assert len(inside) >= len(names)
    # Pages that this small book leaves out are not there, and nothing else is missing.
    left_out = re.compile(
        r"slam/(notebooks/|book/(?!ru/|glossary|conventions|bibliography|how_to))"
    )
    here = [url for url in sorted(inside) if not left_out.search(url)]
    gone = [url for url in here if not (tmp_path / url.removeprefix(home)).exists()]
    assert gone == []
    assert len(here) >= len(names)
