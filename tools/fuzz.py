"""Damage files and spoil arguments much more often than the unit tests do: ``make fuzz N=3``.

Runs the fuzz tests of readers, archives, bags, commands and public calls in one process, with N
times as many damaged files, and says how many files and calls were tried and what was found.
``SEED=7`` damages them in other ways.
"""

from __future__ import annotations

import os
import subprocess
import sys
import xml.etree.ElementTree as ET  # of a report that we have just written
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TESTS = (
    "tests/test_files_fuzz.py",
    "tests/test_archive_fuzz.py",
    "tests/commands/test_damaged_files.py",
    "tests/datasets/test_rosbag.py",
    "tests/commands/test_command_fuzz.py",
    "tests/test_fuzz.py",
)


def main() -> int:
    """Run the tests; the exit code is that of pytest."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    report = ROOT / "_build" / "fuzz.xml"
    report.parent.mkdir(exist_ok=True)
    words = [
        "-q",
        "-p",
        "no:nbval",
        "-p",
        "no:cacheprovider",
        "-o",
        "junit_family=xunit1",
        f"--junitxml={report}",
        *TESTS,
    ]
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    given = os.environ | {"SLAMLAB_FUZZ": str(rounds), "SLAMLAB_FUZZ_SEED": str(seed)}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words], cwd=ROOT, env=given, check=False
    )
    tried, wrong = Counter[str](), 0
    for case in ET.parse(report).iter("testcase"):
        wrong += case.find("failure") is not None or case.find("error") is not None
        for one in case.iter("property"):
            tried[one.attrib["name"]] += int(one.attrib["value"])
    print(f"{tried['files']} damaged files, {tried['calls']} calls: {wrong} tests found something")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
