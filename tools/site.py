"""Make the folder that a static host takes: `make site` copies the built book to _build/site.

BOOK_URL is the address where the folder will be, with its path (https://example.org/slam/). With
it pages name their canonical address and a card for previews, sitemap.xml lists them, and pages of
notebooks have buttons to Colab and Binder. Without it nothing points anywhere.

Buttons need the repository that the hosts read: BOOK_REPOSITORY (owner/name), which follows from
an address of the kind https://owner.github.io/name/. They open the branch `online`, which is the
folder _build/online: each notebook with a first cell that installs what is missing.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from html import escape, unescape
from pathlib import Path
from urllib.parse import quote, urlsplit

ROOT = Path(__file__).resolve().parents[1]
CARD = "_static/killian_before_after.png"
NO_PAGES = {"search.html", "genindex.html", "py-modindex.html"}
INSTALL = """# Installs the course where it is missing (Colab); elsewhere this cell does nothing.
import importlib.util

if importlib.util.find_spec("slamlab") is None:
    %pip install -q "slamlab-course[course] @ git+https://github.com/{repository}"
"""


def address(text: str) -> str:
    """Return BOOK_URL with one slash at its end, or nothing; refuse what is no address."""
    if not text:
        return ""
    parts = urlsplit(text)
    if parts.scheme not in ("http", "https") or not parts.netloc or parts.query or parts.fragment:
        raise SystemExit(f"BOOK_URL: expected an address as https://example.org/slam/, got {text}")
    return text.rstrip("/") + "/"


def repository(url: str, named: str) -> str:
    """Return owner/name: as BOOK_REPOSITORY has it, or from an address of GitHub's pages."""
    if named:
        if not re.fullmatch(r"[\w.-]+/[\w.-]+", named):
            raise SystemExit(f"BOOK_REPOSITORY: expected owner/name, got {named}")
        return named
    found = re.fullmatch(r"https?://([\w-]+)\.github\.io/([\w.-]+)/", url)
    return f"{found[1]}/{found[2]}" if found else ""


def head(text: str, url: str, page: str) -> str:
    """Tags of the head: canonical address, and the card that previews show."""
    title = re.search(r"<title>(.*?)</title>", text, re.S)
    said = re.search(r'<meta name="description" content="([^"]*)"', text)
    name = re.sub(r"\s+", " ", unescape(title[1])).strip() if title else "SLAM, executed"
    where = escape(url + ("" if page == "index.html" else quote(page)))
    tags = [
        f'<link rel="canonical" href="{where}">',
        f'<meta property="og:url" content="{where}">',
        '<meta property="og:type" content="article">',
        f'<meta property="og:title" content="{escape(name)}">',
        f'<meta property="og:image" content="{escape(url + CARD)}">',
        '<meta name="twitter:card" content="summary_large_image">',
    ]
    if said:
        tags.append(f'<meta property="og:description" content="{said[1]}">')
    return "\n".join(tags) + "\n"


def first_page(text: str, site: Path, url: str) -> str:
    """Return the page at the address itself, which leads to the start page and has its card."""
    start = re.search(r'http-equiv="Refresh" content="0; url=([^"]+)"', text)
    if not start:
        return ""
    card = head((site / start[1]).read_text(encoding="utf-8"), url, start[1])
    title = '<meta charset="utf-8">\n<title>SLAM, executed</title>\n'
    inside = f"{title}<meta {start[0]}>\n{card}"
    return f"<!DOCTYPE html>\n<html><head>\n{inside}</head></html>\n"


def buttons(repository: str, notebook: str) -> str:
    """Links that open a notebook at two hosts that run it."""
    path = quote(notebook)
    colab = f"https://colab.research.google.com/github/{repository}/blob/online/{path}"
    binder = f"https://mybinder.org/v2/gh/{repository}/online?labpath={quote(notebook, safe='')}"
    return (
        f'<p class="run-online">Run this page: <a href="{colab}">in Colab</a> or '
        f'<a href="{binder}">on Binder</a>.</p>\n'
    )


def with_install_cell(text: str, repository: str) -> str:
    """Return the notebook with a first cell that installs the course where it is missing."""
    notebook = json.loads(text)
    cell = {
        "cell_type": "code",
        "execution_count": None,
        "id": "install",
        "metadata": {},
        "outputs": [],
        "source": INSTALL.format(repository=repository).splitlines(keepends=True),
    }
    notebook["cells"].insert(0, cell)
    return json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"


def make_site(html: Path, site: Path, url: str = "", repository: str = "") -> list[str]:
    """Copy the pages of `html` to `site`; with an address, point to it. Return the pages."""
    if not (html / "index.html").exists():
        raise SystemExit(f"{html}: expected the built book; run make book")
    shutil.rmtree(site, ignore_errors=True)
    shutil.copytree(html, site, ignore=shutil.ignore_patterns(".buildinfo"))
    (site / ".nojekyll").touch()  # GitHub's pages would leave out folders such as _static
    pages = sorted(
        name
        for name in (path.relative_to(site).as_posix() for path in site.rglob("*.html"))
        if not name.startswith("_") and name not in NO_PAGES
    )
    if not url:
        return pages
    leading = first_page((site / "index.html").read_text(encoding="utf-8"), site, url)
    if leading:
        (site / "index.html").write_text(leading, encoding="utf-8")
        pages.remove("index.html")
    for page in pages:
        path = site / page
        text = path.read_text(encoding="utf-8")
        text = text.replace("</head>", head(text, url, page) + "</head>", 1)
        notebook = page.removesuffix(".html") + ".ipynb"
        if repository and page.startswith("notebooks/") and (ROOT / notebook).exists():
            # The first heading of a page is that of its printed form.
            before, article, after = text.partition("<article")
            after = after.replace("</h1>", "</h1>\n" + buttons(repository, notebook), 1)
            text = before + article + after
        path.write_text(text, encoding="utf-8")
    places = [url + ("" if page == "index.html" else quote(page)) for page in pages]
    lines = [f"  <url><loc>{escape(place)}</loc></url>" for place in places]
    schema = "http://www.sitemaps.org/schemas/sitemap/0.9"
    top = ['<?xml version="1.0" encoding="UTF-8"?>', f'<urlset xmlns="{schema}">']
    sitemap = "\n".join([*top, *lines, "</urlset>"]) + "\n"
    (site / "sitemap.xml").write_text(sitemap, encoding="utf-8")
    (site / "robots.txt").write_text(f"User-agent: *\nSitemap: {url}sitemap.xml\n")
    return pages


def make_online(folder: Path, repository: str, root: Path = ROOT) -> int:
    """Write the branch `online`: notebooks that install what they need. Return how many."""
    shutil.rmtree(folder, ignore_errors=True)
    notebooks = [
        p for p in sorted((root / "notebooks").rglob("*.ipynb")) if ".ipynb_" not in str(p)
    ]
    for path in notebooks:
        target = folder / path.relative_to(root)
        target.parent.mkdir(parents=True, exist_ok=True)
        text = with_install_cell(path.read_text(encoding="utf-8"), repository)
        target.write_text(text, encoding="utf-8")
    course = f"slamlab-course[course] @ git+https://github.com/{repository}\n"
    (folder / "requirements.txt").write_text(course)
    return len(notebooks)


def main() -> int:
    """Make the folder, and say where it is and how it was addressed."""
    url = address(os.environ.get("BOOK_URL", ""))
    name = repository(url, os.environ.get("BOOK_REPOSITORY", "")) if url else ""
    build = ROOT / "_build"
    pages = make_site(build / "html", build / "site", url, name)
    print(f"_build/site: {len(pages)} pages, " + (f"for {url}" if url else "for any address"))
    if name:
        print(f"_build/online: {make_online(build / 'online', name)} notebooks for branch online")
    return 0


if __name__ == "__main__":
    sys.exit(main())
