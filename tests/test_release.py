"""The release says one thing everywhere: version, date, citation, paper."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

import slamlab
from tools.browser import CHROMIUM

ROOT = Path(__file__).resolve().parents[1]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text())
CHANGES = (ROOT / "CHANGELOG.md").read_text()
PAPER = (ROOT / "paper" / "paper.md").read_text()


def test_the_version_is_the_same_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    newest = re.search(r"(?m)^## (\d+\.\d+\.\d+) \(([\d-]+)\)$", CHANGES)
    assert slamlab.__version__ == project["version"] == CITATION["version"] == newest.group(1)
    assert str(CITATION["date-released"]) == newest.group(2)


def test_the_citation_fits_its_schema(tmp_path):
    pytest.importorskip("check_jsonschema")
    words = [sys.executable, "-m", "check_jsonschema", "--builtin-schema"]
    words.append("vendor.citation-file-format")
    # Dates are strings to the schema; YAML 1.2, which the format asks for, agrees.
    done = subprocess.run([*words, ROOT / "CITATION.cff"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    wrong = tmp_path / "CITATION.cff"
    wrong.write_text((ROOT / "CITATION.cff").read_text().replace("title:", "name-of-it:"))
    assert subprocess.run([*words, wrong], capture_output=True).returncode == 1


def test_the_renaming_table_is_kept():
    assert "| old | new |" in CHANGES
    assert "| `Log.looks` | `Log.landmark_measurements` |" in CHANGES


def test_the_paper_has_the_length_and_the_parts_that_the_journal_asks_for():
    _, head, body = PAPER.split("---\n", 2)
    assert 250 <= len(body.split()) <= 1000
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= set(
        yaml.safe_load(head)
    )
    for part in ("Summary", "Statement of need", "Audience", "Experience of use", "Story"):
        assert re.search(rf"(?m)^# {part}", body)


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_the_paper_is_printed_with_the_works_that_it_cites(tmp_path, monkeypatch):
    pypdf = pytest.importorskip("pypdf")
    pytest.importorskip("pypandoc")
    from tools import paper

    assert paper.main(tmp_path / "paper.pdf") == 0
    sheets = [sheet.extract_text() for sheet in pypdf.PdfReader(tmp_path / "paper.pdf").pages]
    text = " ".join(" ".join(sheets).split())
    assert 2 <= len(sheets) <= 5
    assert "SLAM, executed" in sheets[0]
    assert "The slamlab authors" in sheets[0]
    assert "References" in text
    assert "Probabilistic robotics" in text.replace("Robotics", "robotics")
    assert "[@" not in text
    assert "???" not in text  # pandoc's mark of a work that the bibliography does not have
    source = paper.PAPER.read_text().replace("@thrun2005", "@nobody1999")
    wrong = tmp_path / "paper.md"
    wrong.write_text(source)
    (tmp_path / "paper.bib").write_text((paper.PAPER.parent / "paper.bib").read_text())
    monkeypatch.setattr(paper, "PAPER", wrong)
    assert "nobody1999?" in paper.page()


def test_the_paper_cites_what_its_bibliography_has():
    keys = set(re.findall(r"(?m)^@\w+\{(\w+),", (ROOT / "paper" / "paper.bib").read_text()))
    assert set(re.findall(r"@(\w+)", PAPER.split("---\n", 2)[2])) == keys
