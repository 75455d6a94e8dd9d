"""Refresh the browser files that book and slides need, so that no page asks the network.

python tools/vendor.py

Needs npm, and the packages of requirements.lock. Packages are fetched by name; only the files
that a page loads are kept, under book/static/vendor (those of slides beside their template), with
a table of versions and checksums.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VENDOR = ROOT / "book" / "static" / "vendor"
SLIDES = ROOT / "tools" / "templates" / "slides" / "reveal"  # not among the files of the book
NPM = {
    "mathjax": "3.2.2",
    "requirejs": "2.3.8",
    "@jupyter-widgets/html-manager": "1.0.15",
    "reveal.js": "4.6.1",
}

# embed-amd.js looks for its icon fonts beside the page; they lie beside the script.
BESIDE_PAGE = "document.baseURI||self.location.href"
BESIDE_SCRIPT = "window.slamlabVendor||document.baseURI"
REMEMBER = "window.slamlabVendor=document.currentScript&&document.currentScript.src;\n"


def fetch(package: str, version: str, folder: Path) -> Path:
    """Download one npm package and return its unpacked folder."""
    print(f"npm pack {package}@{version}", flush=True)
    packed = subprocess.run(
        ["npm", "pack", "--silent", "--json", f"{package}@{version}"],
        cwd=folder,
        check=True,
        capture_output=True,
        text=True,
    )
    answer = json.loads(packed.stdout)
    entry = answer[0] if isinstance(answer, list) else next(iter(answer.values()))
    target = folder / package.replace("/", "-")
    with tarfile.open(folder / entry["filename"].replace("@", "").replace("/", "-")) as archive:
        archive.extractall(target, filter="data")
    return target / "package"


def copy(source: Path, pattern: str, target: Path) -> None:
    """Copy all files of `source` that match, with their folders."""
    found = [path for path in sorted(source.glob(pattern)) if path.is_file()]
    if not found:
        raise SystemExit(f"{source}: nothing matches {pattern}")
    for path in found:
        place = target / path.relative_to(source)
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, place)


def html_manager(source: Path, target: Path) -> None:
    """Copy the widget manager, its fonts found beside the script."""
    copy(source / "dist", "*.woff2", target)
    script = (source / "dist" / "embed-amd.js").read_text()
    if BESIDE_PAGE not in script:
        raise SystemExit("embed-amd.js: the expression for the fonts' place is not there")
    (target / "embed-amd.js").write_text(REMEMBER + script.replace(BESIDE_PAGE, BESIDE_SCRIPT))


def reveal(source: Path, target: Path) -> None:
    """Copy what a deck of slides needs; its theme takes letters that every machine has."""
    for name in (
        "dist/reveal.js",
        "dist/reveal.css",
        "dist/theme/white.css",
        "plugin/notes/notes.js",
    ):
        copy(source, name, target)
    theme = target / "dist" / "theme" / "white.css"
    theme.write_text(re.sub(r"(?m)^@import .*\n", "", theme.read_text()))


def write_table(rows: list[tuple[str, str, str]]) -> None:
    """Write README.md: packages, versions, licences, and the checksum of every file."""
    lines = [
        "# Vendored browser files",
        "",
        "Written by `tools/vendor.py`; do not edit by hand.",
        "",
        "| package | version | licence |",
        "| --- | --- | --- |",
        *(f"| {name} | {version} | {licence} |" for name, version, licence in rows),
        "",
        "| file | bytes | sha256 |",
        "| --- | --- | --- |",
    ]
    for path in [*sorted(VENDOR.rglob("*")), *sorted(SLIDES.rglob("*"))]:
        if path.is_file() and path.name != "README.md":
            data = path.read_bytes()
            name = path.relative_to(VENDOR if VENDOR in path.parents else ROOT).as_posix()
            lines.append(f"| {name} | {len(data)} | `{hashlib.sha256(data).hexdigest()}` |")
    (VENDOR / "README.md").write_text("\n".join(lines) + "\n")


def main() -> int:
    """Fetch, copy, patch, and write the table."""
    shutil.rmtree(VENDOR, ignore_errors=True)
    VENDOR.mkdir(parents=True)
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folders = {package: fetch(package, v, Path(name)) for package, v in NPM.items()}
        for package, folder in folders.items():
            licence = json.loads((folder / "package.json").read_text())["license"]
            rows.append((package, NPM[package], licence))
        es5 = folders["mathjax"] / "es5"
        copy(es5, "tex-mml-chtml.js", VENDOR / "mathjax")
        copy(es5, "output/chtml/fonts/**/*", VENDOR / "mathjax")
        copy(es5, "input/tex/extensions/**/*", VENDOR / "mathjax")
        copy(folders["requirejs"], "require.js", VENDOR / "requirejs")
        reveal(folders["reveal.js"], SLIDES)
        target = VENDOR / "html-manager"
        target.mkdir()
        html_manager(folders["@jupyter-widgets/html-manager"], target)
    version = importlib.metadata.version("anywidget")
    copy(
        Path(sys.prefix) / "share/jupyter/nbextensions/anywidget", "index.js", VENDOR / "anywidget"
    )
    rows.append(("anywidget", version, "MIT"))
    write_table(rows)
    size = sum(path.stat().st_size for path in VENDOR.rglob("*") if path.is_file())
    print(f"book/static/vendor: {size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
