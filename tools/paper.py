"""Print the paper, paper/paper.md with its bibliography: `make paper` writes _build/paper.pdf.

The journal's own tool runs pandoc, too; here its page goes through Chromium.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pypandoc
import yaml
from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.browser import CHROMIUM

ROOT = Path(__file__).resolve().parents[1]
PAPER = ROOT / "paper" / "paper.md"
STYLE = """<style>
html { font-size: 11pt; color: black; background: white; }
body { max-width: none; margin: 0; padding: 0; font-family: serif; line-height: 1.45; }
h1 { font-size: 1.25rem; margin: 1.4em 0 0.4em; } h1.title { font-size: 1.7rem; }
code { font-size: 0.85em; } .csl-entry { margin-bottom: 0.5em; }
</style>"""


def page() -> str:
    """Return the paper as a page: title, authors, text, and the works that it cites."""
    head = yaml.safe_load(PAPER.read_text(encoding="utf-8").split("---\n", 2)[1])
    return pypandoc.convert_file(
        str(PAPER),
        "html",
        format="markdown",
        extra_args=[
            "--standalone",
            "--citeproc",
            f"--bibliography={PAPER.parent / head['bibliography']}",
            "--metadata=link-citations=true",
            "--metadata=lang=en",
            f"--metadata=author={', '.join(one['name'] for one in head['authors'])}",
        ],
    )


def main(output: Path = ROOT / "_build" / "paper.pdf") -> int:
    """Print it; 1 if there is no browser."""
    if CHROMIUM is None:
        print("chromium is not installed", file=sys.stderr)
        return 1
    output.parent.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        tab = browser.new_page()
        tab.set_content(page().replace("</head>", f"{STYLE}</head>"))
        margin = dict.fromkeys(("top", "bottom", "left", "right"), "2.3cm")
        tab.pdf(path=str(output), format="A4", margin=margin, tagged=True)
        browser.close()
    print(output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
