"""Print the built book into one PDF: title, contents with page numbers, bookmarks, links inside.

python tools/pdf.py                      every chapter and the pages behind them, _build/slam.pdf
python tools/pdf.py notebooks/02* -o x.pdf    only pages whose names fit

The pages are printed by headless Chromium; the API and the solutions stay on the screen.
"""

from __future__ import annotations

import argparse
import fnmatch
import html
import io
import sys
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlparse

import yaml
from playwright.sync_api import Browser, sync_playwright
from pypdf import PdfReader, PdfWriter
from pypdf.generic import ArrayObject, DictionaryObject, NameObject

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.browser import CHROMIUM, serving

ROOT = Path(__file__).resolve().parents[1]
HTML = ROOT / "_build" / "html"
LEFT_OUT = ("book/api*", "notebooks/solutions/*")
PAPER = {
    "format": "A4",
    "print_background": True,
    "margin": {"top": "18mm", "bottom": "20mm", "left": "16mm", "right": "16mm"},
}
READY = """async () => {
  if (window.MathJax && MathJax.startup) await MathJax.startup.promise;
  await document.fonts.ready;
  for (const image of document.images) { image.loading = "eager"; await image.decode().catch(() => 0); }
}"""  # noqa: E501
STYLE = """<style>@page { margin: 0 } body { font: 11pt/1.5 "DejaVu Sans", sans-serif; margin: 0 }
.sheet { height: 296mm; position: relative; break-after: page }
.number { position: absolute; bottom: 9mm; width: 100%; text-align: center; font-size: 9pt }
.contents { margin: 22mm 22mm } h1 { font-size: 26pt } h2 { font-size: 12pt; margin: 1em 0 0 }
.row { display: flex } .row span { flex: 1; border-bottom: 1px dotted #888; margin: 0 .5em .4em }
</style>"""


@dataclass(frozen=True)
class Leaf:
    """A page of the book, printed: its part, its name, its title, and its sheets."""

    part: str
    name: str
    title: str
    printed: PdfReader


def pages_of(toc: Path, wanted: list[str]) -> list[tuple[str, str]]:
    """Return the part and the name of each page in the order of the table of contents."""
    tree = yaml.safe_load(toc.read_text())
    found = [("", tree["root"])]
    for part in tree["parts"]:
        for chapter in part["chapters"]:
            entries = [chapter, *chapter.get("sections", [])]
            found += [(part["caption"], entry["file"]) for entry in entries]
    return [
        (part, name)
        for part, name in found
        if any(fnmatch.fnmatch(name, glob) for glob in wanted)
        and not any(fnmatch.fnmatch(name, glob) for glob in LEFT_OUT)
    ]


def print_page(browser: Browser, address: str, part: str, name: str) -> Leaf:
    """Open a page of the book, wait until it is drawn, and print it."""
    tab = browser.new_page(viewport={"width": 900, "height": 1200}, color_scheme="light")
    tab.goto(f"{address}{name}.html", wait_until="load")
    tab.emulate_media(media="print")
    tab.evaluate(READY)
    title = tab.title().split(" — ")[0].strip()
    sheets = PdfReader(io.BytesIO(tab.pdf(**PAPER)))
    tab.close()
    return Leaf(part, name, title, sheets)


def print_text(browser: Browser, body: str) -> PdfReader:
    """Print a page of our own."""
    tab = browser.new_page()
    tab.set_content(STYLE + body)
    printed = PdfReader(io.BytesIO(tab.pdf(format="A4", print_background=True)))
    tab.close()
    return printed


def contents(leaves: list[Leaf], first: int) -> str:
    """Write the title and the table of contents; the first chapter begins on sheet `first`."""
    lines, part, sheet = ["<div class=contents><h1>SLAM, executed</h1>"], "", first
    for leaf in leaves:
        if leaf.part != part:
            part = leaf.part
            lines.append(f"<h2>{html.escape(part)}</h2>")
        lines.append(f"<div class=row>{html.escape(leaf.title)}<span></span>{sheet}</div>")
        sheet += len(leaf.printed.pages)
    return "\n".join([*lines, "</div>"])


def numbers(count: int) -> str:
    """As many empty sheets as the book has, each with its number."""
    return "".join(f"<div class=sheet><div class=number>{k + 1}</div></div>" for k in range(count))


def turn_links_inside(writer: PdfWriter, starts: dict[str, int], address: str) -> None:
    """Let links between pages of the book lead to the sheets of this file."""
    for sheet in writer.pages:
        for entry in sheet.get("/Annots") or ():
            action = entry.get_object().get("/A")
            uri = str(action.get_object().get("/URI", "")) if action else ""
            if not uri.startswith(address):
                continue
            target = starts.get(unquote(urlparse(uri).path).strip("/").removesuffix(".html"))
            if target is None:
                del entry.get_object()["/A"]  # a page that is not in this file
                continue
            place = ArrayObject([writer.pages[target].indirect_reference, NameObject("/Fit")])
            entry.get_object()[NameObject("/A")] = DictionaryObject(
                {NameObject("/S"): NameObject("/GoTo"), NameObject("/D"): place}
            )


def bind(browser: Browser, leaves: list[Leaf], address: str) -> PdfWriter:
    """Put contents and pages together, number the sheets, add bookmarks and links."""
    front = print_text(browser, contents(leaves, 1))
    front = print_text(browser, contents(leaves, len(front.pages) + 1))
    writer, starts, parts = PdfWriter(), {}, {}
    for sheet in front.pages:
        writer.add_page(sheet)
    writer.add_outline_item(title="Contents", page_number=0)
    for leaf in leaves:
        starts[leaf.name] = len(writer.pages)
        for sheet in leaf.printed.pages:
            writer.add_page(sheet)
        if leaf.part and leaf.part not in parts:
            parts[leaf.part] = writer.add_outline_item(
                title=leaf.part, page_number=starts[leaf.name]
            )
        writer.add_outline_item(
            title=leaf.title, page_number=starts[leaf.name], parent=parts.get(leaf.part)
        )
    stamps = print_text(browser, numbers(len(writer.pages)))
    for sheet, stamp in zip(writer.pages, stamps.pages, strict=True):
        sheet.merge_page(stamp)
    turn_links_inside(writer, starts, address)
    return writer


def main() -> int:
    """Print, bind, and say where the file is."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", nargs="*", default=["*"], help="names, such as notebooks/02*")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "_build" / "slam.pdf")
    arguments = parser.parse_args()
    names = pages_of(ROOT / "_toc.yml", arguments.pages)
    missing = [name for _, name in names if not (HTML / f"{name}.html").exists()]
    if CHROMIUM is None or missing or not names:
        why = f"{missing[0]} is not built: run make book" if missing else "no page fits"
        print("chromium is not installed" if CHROMIUM is None else why, file=sys.stderr)
        return 1
    with sync_playwright() as playwright, serving(HTML) as address:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        leaves = []
        for part, name in names:
            leaves.append(print_page(browser, address, part, name))
            print(f"{len(leaves[-1].printed.pages):4d} sheets  {name}", flush=True)
        writer = bind(browser, leaves, address)
        browser.close()
    writer.compress_identical_objects()
    writer.write(arguments.output)
    size = arguments.output.stat().st_size / 1e6
    print(f"{len(writer.pages)} sheets, {size:.1f} MB: {arguments.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
