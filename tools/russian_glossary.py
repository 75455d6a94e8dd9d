"""Write the Russian glossary, book/ru/glossary.md, from the English one.

python tools/russian_glossary.py
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "book" / "glossary.md"
TARGET = ROOT / "book" / "ru" / "glossary.md"
HEAD = """# Словарь: русско-английский

Русские термины пяти работ (P1–P5) и их английские соответствия, {count} строк. Определения даны
на странице [Glossary](../glossary.md): слово в правом столбце ведёт к своему определению.
[Русская стартовая страница](index.md)

| по-русски | по-английски |
|---|---|
"""


def entries(text: str) -> list[tuple[str, str]]:
    """Return (Russian, English) of every entry that has a Russian word."""
    found = re.findall(r"(?m)^(\S.*)\n  \*\*(.+?)\*\*", text)
    pairs = [(russian, english) for english, russian in found]
    return sorted(pairs, key=lambda pair: (pair[0].lower().replace("ё", "е"), pair[1]))


def page(text: str) -> str:
    """Return the Russian page for an English one."""
    pairs = entries(text)
    rows = [f"| {russian} | {{term}}`{english}` |" for russian, english in pairs]
    return HEAD.format(count=len(pairs)) + "\n".join(rows) + "\n"


def main() -> int:
    """Write the page."""
    TARGET.write_text(page(SOURCE.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
