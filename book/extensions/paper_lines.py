"""Sphinx extension: the page "The papers, line by line", built from book/papers/*.yaml.

A line that the errata hold takes verdict, repair and tests from there, so that the two pages
cannot disagree. A place is a chapter and words in it; its link goes to the heading above them.
"""

import functools
import html
import json
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).resolve().parents[2]
KINDS = ("text", "claim", "formula", "algorithm", "program", "figure", "table", "experiment")
READ = ("clear", "unclear", "restored")
VERDICTS = ("right", "confirmed", "incomplete", "typo", "wrong", "wrong as read", "refuted",
            "unsupported", "on record", "no claim", "not judged")  # fmt: skip

Row = tuple[str | None, list[str], dict[str, str]]  # file, cells, tests by letter


def errata_rows(text: str) -> list[Row]:
    """Read every row: its cells, the file named above its table, the list of tests below it."""
    rows = []
    for section in text.split("\n## ")[1:]:
        file = re.search(r"^Proved in `(tests/\S+\.py)`", section, re.MULTILINE)
        named = dict(re.findall(r"^- (\w): `(test_\w+)`$", section, re.MULTILINE))
        for line in re.findall(r"^\| P.*$", section, re.MULTILINE):
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            rows.append((file and file[1], cells, named))
    return rows


@functools.cache
def errata() -> list[Row]:
    """Read the page of errata."""
    return errata_rows((ROOT / "book" / "errata.md").read_text(encoding="utf-8"))


def errata_of(paper: str, key: str) -> list[Row]:
    """Return the rows whose formula is the key, or whose "formula: as printed" begins with it."""
    mine = [row for row in errata() if row[1][0] == paper]
    exact = [row for row in mine if row[1][1] == key]
    return exact or [row for row in mine if f"{row[1][1]}: {row[1][2]}".startswith(key)]


def word(line: dict[str, Any], verdict: str) -> str:
    """Say the verdict of a row of the errata in the words of this page."""
    formal = line["kind"] in ("formula", "program", "algorithm") or line["name"][0] in "(`"
    words = {"correct": "right"} if formal else {"correct": "confirmed", "wrong": "refuted"}
    return words.get(verdict, verdict)


@functools.cache
def cite(key: str) -> str:
    """Link to an entry of the bibliography by its first author and year; "" if there is none."""
    text = (ROOT / "book" / "references.bib").read_text(encoding="utf-8")
    entry = re.search(rf"@\w+\{{{key},(.*?)\n\}}", text, re.DOTALL)
    fields = (
        dict(re.findall(r"(author|year)\s*=\s*\{(.*?)\}(?:,|$)", entry[1], re.MULTILINE))
        if entry
        else {}
    )
    if len(fields) < 2:
        return ""
    authors = [name.partition(",")[0] for name in fields["author"].split(" and ")]
    said = authors[0] + (
        f" and {authors[1]}" if len(authors) == 2 else " et al." * (len(authors) > 2)
    )
    return f"[{said} ({fields['year']})](bibliography.md#{key})"


@functools.cache
def paper(name: str) -> dict[str, Any]:
    """Read a paper and its lines, with what the errata know of them."""
    file = ROOT / "book" / "papers" / f"{name.lower()}.yaml"
    data: dict[str, Any] = yaml.safe_load(file.read_text(encoding="utf-8"))
    for line in data["lines"]:
        notes, tests = [], list(line.get("tests", []))
        rows = [row for key in line.get("errata", []) for row in errata_of(name, key)]
        for where, cells, named in rows:
            line["verdict"] = word(line, cells[3])
            notes.append(cells[4])
            tests += [f"{where}::{named.get(letter)}" for letter in cells[5].split(", ")]
        notes += [line.get("note", ""), ", ".join(map(cite, line.get("sources", [])))]
        line["notes"] = [note for note in dict.fromkeys(notes) if note]
        line["tests"] = list(dict.fromkeys(tests))
    return data


def papers() -> list[str]:
    """List the papers."""
    return sorted(file.stem.upper() for file in (ROOT / "book" / "papers").glob("p*.yaml"))


@functools.cache
def chapter(number: str) -> tuple[str, list[dict[str, Any]]]:
    """Read document and cells of a chapter; `sim` is the simulator."""
    pattern = "simulator.ipynb" if number == "sim" else f"{number}_*.ipynb"
    (file,) = (ROOT / "notebooks").glob(pattern)
    return f"notebooks/{file.stem}", json.loads(file.read_text(encoding="utf-8"))["cells"]


def said(cell: dict[str, Any]) -> str:
    """Join the source of a cell and what it printed."""
    outputs = cell.get("outputs", [])
    printed = (out.get("text", out.get("data", {}).get("text/plain", "")) for out in outputs)
    return "\n".join("".join(text) for text in (cell["source"], *printed))


def find(place: str, code: bool = False) -> tuple[str, str] | None:
    """Find document and heading of "chapter: words"; None where the words do not stand there."""
    number, _, words = (part.strip() for part in place.partition(":"))
    document, cells = chapter(number)
    heading = ""
    for cell in cells if words else ():
        text = said(cell)
        at = text.find(words)
        found = at >= 0 and (not code or cell["cell_type"] == "code")
        if cell["cell_type"] == "markdown":
            until = (text + "\n").index("\n", at) if found else len(text)
            heading = ["", heading, *re.findall(r"(?m)^##+ (.*)$", text[:until])][-1]
        if found:
            return document, heading
    return None if words else (document, "")


class Place(nodes.Inline, nodes.TextElement):
    """A place in a chapter; it becomes a link when all pages are read."""


def table(kind: str, widths: Iterable[int], rows: list[nodes.row]) -> nodes.table:
    """Build a table; its first row is the head."""
    columns = [nodes.colspec(colwidth=width) for width in widths]
    group = nodes.tgroup("", *columns, cols=len(columns))
    group += [nodes.thead("", rows[0]), nodes.tbody("", *rows[1:])]
    return nodes.table("", group, classes=[kind])


def plain_row(cells: Iterable[Any]) -> nodes.row:
    """Build a row of words."""
    return nodes.row("", *(nodes.entry("", nodes.paragraph("", str(cell))) for cell in cells))


class PaperLines(SphinxDirective):
    """The head and the table of one paper."""

    required_arguments = 1

    def markdown(self, text: str) -> list[nodes.Node]:
        """Parse a piece in the language of the page."""
        box = nodes.container()
        self.state.nested_parse(StringList(text.split("\n")), self.content_offset, box)
        return list(box.children)

    def places(self, line: dict[str, Any]) -> list[nodes.Node]:
        """Link to the chapters, and fold the tests below."""
        found = [find(place) for place in line.get("at", [])]
        found += [find(place, code=True) for place in line.get("cells", [])]
        places = dict.fromkeys(place for place in found if place)
        deep = {document for document, heading in places if heading}
        links = nodes.paragraph(classes=["paper-places"])
        for document, heading in places:
            if heading or document not in deep:
                links += nodes.Text("; " if links.children else "")
                links += Place("", document, target=document, heading=heading)
        items = "".join(f"<li><code>{html.escape(test)}</code></li>" for test in line["tests"])
        count = f"{len(line['tests'])} test{'s' * (len(line['tests']) > 1)}"
        fold = f"<details class='paper-tests'><summary>{count}</summary><ul>{items}</ul></details>"
        raw = [nodes.raw("", fold, format="html")] if items else []
        return [*([links] if links.children else []), *raw]

    def row(self, line: dict[str, Any]) -> nodes.row:
        """Build a row: the number; what it says; verdict, chapter, tests."""
        kind = line["kind"] + ("" if line["read"] == "clear" else f", read: {line['read']}")
        name = [*self.markdown(line["name"]), nodes.paragraph("", kind, classes=["paper-kind"])]
        says = self.markdown(line["says"])
        if "ru" in line:
            quote = f"<p class='paper-ru' lang='ru'>«{html.escape(line['ru'])}»</p>"
            says.append(nodes.raw("", quote, format="html"))
        colon = ": " if line["notes"] else ""
        judged = self.markdown(f"**{line['verdict']}**{colon}{'; '.join(line['notes'])}")
        cells = (nodes.entry("", *each) for each in (name, says, judged + self.places(line)))
        return nodes.row("", *cells, classes=["verdict-" + line["verdict"].replace(" ", "-")])

    def run(self) -> list[nodes.Node]:
        """Build the head and the table."""
        name = self.arguments[0]
        data = paper(name)
        for file in (f"papers/{name.lower()}.yaml", "errata.md"):
            self.env.note_dependency(str(ROOT / "book" / file))
        counts = Counter(line["verdict"] for line in data["lines"])
        tally = ", ".join(
            f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts[verdict]
        )
        restored = sum(line["read"] == "restored" for line in data["lines"])
        if restored:
            tally += f"; {restored} of them judge formulas that we restored"
        head = self.markdown(
            f"*Authors*: {data['authors']}. *Title*: {data['title']}. *Year*: {data['year']}. "
            f"*Where to find it*: {data['find']}. "
            f"([Bibliography](bibliography.md#{data['key']}).)\n\n"
            f"{len(data['lines'])} lines: {tally}."
        )
        titles = plain_row(("place", "what it says", "verdict, chapter, test"))
        rows = [titles, *(self.row(line) for line in data["lines"])]
        return [*head, table("paper-lines", (14, 46, 40), rows)]


class PaperCounts(SphinxDirective):
    """How many lines of each paper have which verdict; the browser adds its buttons below."""

    def run(self) -> list[nodes.Node]:
        """Build the table."""
        names = papers()
        counts = [Counter(line["verdict"] for line in paper(name)["lines"]) for name in names]
        counts.append(sum(counts, Counter()))
        rows = [plain_row(["verdict", *names, "all"])]
        rows += [plain_row([verdict, *(each[verdict] for each in counts)]) for verdict in VERDICTS]
        rows.append(plain_row(["lines", *(each.total() for each in counts)]))
        restored = [sum(line["read"] == "restored" for line in paper(p)["lines"]) for p in names]
        rows.append(plain_row(["of them restored by us", *restored, sum(restored)]))
        return [table("paper-counts", [1] * (len(counts) + 1), rows)]


def letters(text: str) -> str:
    """Keep letters and digits of a heading."""
    return re.sub(r"[^a-z0-9]", "", text.lower())


def link_places(app: Any, doctree: Any, document: str) -> None:
    """Turn places into links to the heading under which they stand."""
    for node in list(doctree.findall(Place)):
        target, heading = node["target"], node["heading"]
        anchors = {
            letters(reference.astext()): (reference["anchorname"], reference.astext())
            for reference in app.env.tocs[target].findall(nodes.reference)
        }
        anchor, title = anchors.get(letters(heading), ("", ""))
        number = target.split("/")[1].split("_")[0]
        uri = app.builder.get_relative_uri(document, target) + anchor
        text = f"{number} {title}" if title else f"chapter {number}".replace("chapter s", "s")
        node.replace_self(nodes.reference("", text, internal=True, refuri=uri))


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_directive("paper-lines", PaperLines)
    app.add_directive("paper-counts", PaperCounts)
    app.add_node(Place)
    app.connect("doctree-resolved", link_places)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
