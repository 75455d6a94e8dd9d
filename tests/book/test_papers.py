"""The papers, line by line: nothing is missing, and each place and each test named exists."""

import ast
import functools
import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "book" / "extensions"))
from paper_lines import (  # noqa: E402
    KINDS,
    READ,
    VERDICTS,
    cite,
    errata,
    errata_of,
    find,
    paper,
    papers,
)

# Verdicts that stand on a word of ours, not on a run.
WORDS = ("not judged", "typo", "unsupported", "on record", "no claim")
LINES = [(name, line) for name in papers() for line in paper(name)["lines"]]
# What the papers number themselves; P3 and P4 name their formulas by step or variant.
DUE = {
    "P1": [*(f"({n})" for n in range(1, 44)), *(f"figure {n}" for n in range(1, 5))],
    "P2": [*(f"({n})" for n in range(1, 19)), *(f"figure {n}" for n in range(1, 6))],
    "P3": ["(1)", *(f"figure {n}" for n in range(1, 5)), "table 1", "algorithm 1.1-1.5",
           "algorithm 1.6", "algorithm 1.7", "algorithm 2.1-2.3", "algorithm 2.4", "one point",
           "point and derivative", "two points", "two points and derivative"],
    "P4": ["(2a)", "(2b)", "(3a)", "(3b)", "(3c)", "(4a)", "(4b)", "(4c)"],
    "P5": [*(f"({n})" for n in range(1, 16)), "(14), second",
           *(f"figure {n}" for n in range(1, 22)), "`nvec`", "`Turndot`", "`Move`", "`Turn`",
           "`Scan`", "`distancetodots`", "`Whatangle`", "`whatmove`", "`CanMove`", "`acf`"],
}  # fmt: skip


def numbers(name):
    """All numbers that a name stands for: "(12), (13)", "(1)-(4)", "figures 18, 19"."""
    found = {name, *re.findall(r"`\w+`", name), *re.findall(r"\(\d+\w?\)", name)}
    for first, last in re.findall(r"\((\d+)\)-\((\d+)\)", name):
        found |= {f"({n})" for n in range(int(first), int(last) + 1)}
    for listed in re.findall(r"figures? ([\d, ]+)", name):
        found |= {f"figure {n}" for n in re.findall(r"\d+", listed)}
    return found | {name.partition(",")[0]}


@functools.cache
def functions_of(file):
    """Names of the tests of a file, the skipped ones left out."""
    tree = ast.parse((ROOT / file).read_text()) if (ROOT / file).is_file() else ast.Module([], [])
    found = (node for node in tree.body if isinstance(node, ast.FunctionDef))
    return {node.name for node in found if "skip" not in ast.dump(ast.List(node.decorator_list))}


def faults(name, line):
    """Say what is wrong with a line."""
    found = [f"no such place: {at}" for at in line.get("at", []) if find(at) is None]
    found += [f"no such cell: {c}" for c in line.get("cells", []) if find(c, code=True) is None]
    for test in line["tests"]:
        file, _, function = test.partition("::")
        found += [f"no such test: {test}"] if function not in functions_of(file) else []
    found += [f"no such row: {key}" for key in line.get("errata", []) if not errata_of(name, key)]
    verdict = line.get("verdict")
    known = (line["kind"] in KINDS, line["read"] in READ, verdict in VERDICTS, line["says"])
    found += [] if all(known) else ["a word that the page does not explain"]
    found += [f"no such source: {key}" for key in line.get("sources", []) if not cite(key)]
    if verdict in WORDS and not line["notes"]:
        found.append("no proof, and no word why")
    if verdict not in WORDS and not line["tests"] + line.get("cells", []):
        found.append("a verdict that nothing proves")
    if (verdict == "on record") != ("sources" in line):
        found.append("on record is what a source says")
    if verdict == "no claim" and line["kind"] in ("claim", "formula", "algorithm", "program"):
        found.append("it claims something")
    if verdict in ("wrong", "refuted") and line["read"] != "clear":
        found.append("wrong is said of what was read clearly")
    if verdict == "wrong as read" and line["read"] == "clear":
        found.append("it was read clearly: wrong")
    spoken = line["kind"] in ("claim", "text", "experiment")
    if spoken and verdict in ("wrong", "refuted", "unsupported") and "ru" not in line:
        found.append("a sentence is judged, and its own words are missing")
    return found


@pytest.mark.parametrize("name", papers())
def test_every_line_has_a_verdict_a_place_that_exists_and_a_test_that_exists(name):
    wrong = {line["name"]: faults(name, line) for paper, line in LINES if paper == name}
    assert {line: why for line, why in wrong.items() if why} == {}


def test_no_line_is_left_without_a_verdict():
    assert [line["says"] for _, line in LINES if line["verdict"] == "not judged"] == []


@pytest.mark.parametrize("name", papers())
def test_no_numbered_formula_figure_or_program_is_missing(name):
    there = set().union(*(numbers(line["name"]) for paper, line in LINES if paper == name))
    assert set(DUE[name]) - there == set()


def test_the_errata_are_a_part_of_the_lines_and_agree():
    named = {}
    for name, line in LINES:
        for key in line.get("errata", []):
            for row in errata_of(name, key):
                named.setdefault(id(row), []).append((row, line))
    assert [row[1][:3] for row in errata() if id(row) not in named] == []
    for rows in named.values():
        for (_, cells, _), line in rows:
            assert ("wrong as read" == cells[3]) == (line["verdict"] == "wrong as read"), cells


def test_each_paper_says_who_wrote_it_and_where_it_is_found():
    bibliography = (ROOT / "book" / "references.bib").read_text(encoding="utf-8")
    for name in papers():
        data = paper(name)
        assert all(data[key] for key in ("authors", "title", "year", "find"))
        assert f"{{{data['key']}," in bibliography


def test_the_page_shows_every_paper():
    page = (ROOT / "book" / "papers.md").read_text(encoding="utf-8")
    assert re.findall(r"```\{paper-lines\} (P\d)", page) == papers()
    assert all(verdict in page for verdict in VERDICTS)


SELF = str(Path(__file__).relative_to(ROOT))
GOOD = {"name": "(1)", "kind": "formula", "says": "x", "read": "clear", "verdict": "right",
        "notes": [], "tests": [f"{SELF}::test_the_guard_refuses"]}  # fmt: skip
BAD = [
    {"tests": []}, {"tests": ["tests/book/test_papers.py::test_nobody_wrote_this"]},
    {"at": ["01: words that no chapter has, surely"]}, {"cells": ["01: One number by hand"]},
    {"verdict": "fine"}, {"verdict": "wrong", "read": "unclear"},
    {"verdict": "not judged", "tests": []}, {"verdict": "wrong as read"},
    {"errata": ["(99)"]}, {"kind": "poem"}, {"verdict": "unsupported", "tests": []},
    {"verdict": "on record", "notes": ["a book"]}, {"sources": ["thrun2005probabilistic"]},
    {"verdict": "on record", "notes": ["a book"], "sources": ["nobody1900"]},
    {"verdict": "no claim", "notes": ["a drawing"]}, {"kind": "claim", "verdict": "refuted"},
]  # fmt: skip


@pytest.mark.parametrize("change", BAD)
def test_the_guard_refuses(change):
    assert faults("P1", GOOD) == []
    assert faults("P1", {**GOOD, **change})


# One mistake, one verdict: what a chapter's table says of a numbered formula, and this page.

OF_CHAPTER = {"05": "P1", "07": "P1", "09": "P1", "10": "P2", "11": "P4", "12": "P2", "19": "P5"}
RIGHT, WRONG = {"right", "confirmed"}, {"wrong", "wrong as read", "refuted"}
FAULTY = WRONG | {"typo", "incomplete"}


def verdicts_of(path):
    """Verdicts of claims that begin with a number of a formula, as {(paper, number): verdicts}."""
    found = {}
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        for output in cell.get("outputs", []):
            table = "".join(output.get("data", {}).get("text/plain", ""))
            if not re.search(r"holds if +verdict", table):
                continue
            for line in table.splitlines():
                said = re.match(r"(?:(P\d) )?\((\d+[a-z]?)\)(?=[ :,]).* (\w+) *$", line)
                if said:
                    key = said[1] or OF_CHAPTER[path.name[:2]], said[2]
                    found.setdefault(key, set()).add(said[3])
    return found


def contradictions(in_chapter, on_page):
    """Formulas that a chapter only refutes and the page calls right, or the other way round."""
    return [
        key
        for key, said in in_chapter.items()
        if (said == {"refuted"} and not on_page[key] & FAULTY)
        or (said == {"confirmed"} and on_page[key] & WRONG and not on_page[key] & RIGHT)
    ]


def test_a_formula_has_one_verdict_in_its_chapters_and_on_the_page():
    on_page = {}
    for name, line in LINES:
        for number in numbers(line["name"]):
            on_page.setdefault((name, number.strip("()")), set()).add(line["verdict"])
    chapters = [verdicts_of(path) for path in sorted((ROOT / "notebooks").glob("[0-9]*.ipynb"))]
    assert sum(len(one) for one in chapters) > 20
    for one in chapters:
        assert contradictions(one, on_page) == []
    for key in set().union(*chapters):
        alone = [one[key] for one in chapters if key in one and len(one[key]) == 1]
        assert len(set(map(frozenset, alone))) <= 1, key
    assert contradictions({("P1", "17"): {"confirmed"}}, on_page) == [("P1", "17")]
    assert contradictions({("P1", "10"): {"refuted"}}, on_page) == [("P1", "10")]
