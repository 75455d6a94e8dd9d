"""Stock JupyterLab, the student's door: a chapter and an exercise are opened, run and touched."""

import json
import os
import re
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from tools.browser import CHROMIUM

sync_api = pytest.importorskip("playwright.sync_api")
pytest.importorskip("jupyterlab")
ROOT = Path(__file__).resolve().parents[2]
CHAPTER = "01_bayes_filter.ipynb"
RAW = re.compile(r"(?m)^:::|```\{|\{(doc|cite|ref|eq|numref)[:}]")
PICTURE = """() => [...document.querySelectorAll('.jp-OutputArea canvas')]
    .sort((a, b) => b.width * b.height - a.width * a.height)[0].toDataURL()"""
DRAWN = """texts => [...document.querySelectorAll('.jp-MarkdownCell .jp-RenderedMarkdown')]
    .filter(e => e.textContent.trim()).length === texts"""

pytestmark = [
    pytest.mark.book,
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed"),
]


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A JupyterLab of its own on copies of a chapter and of its exercises."""
    home = tmp_path_factory.mktemp("lab")
    for name in (CHAPTER, f"exercises/{CHAPTER}"):
        (home / "notebooks" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / "notebooks" / name, home / "notebooks" / name)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "jupyterlab", "--no-browser", f"--port={port}"]
    command += [
        "--IdentityProvider.token=",
        "--allow-root",
        f"--notebook-dir={home / 'notebooks'}",
    ]
    folders = {f"JUPYTER_{kind}_DIR": str(home / kind) for kind in ("CONFIG", "DATA", "RUNTIME")}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    # A group of its own, so that its kernels end with it.
    server = subprocess.Popen(
        command, env={**os.environ, **folders, "PYTHONPATH": str(ROOT)}, start_new_session=True,
        **quiet,
    )  # fmt: skip
    address = f"http://127.0.0.1:{port}/lab"
    for _ in range(300):
        try:
            urllib.request.urlopen(f"{address}/api/settings", timeout=1)
            break
        except OSError:
            time.sleep(0.2)
    yield address
    os.killpg(server.pid, 15)
    server.wait(20)


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        flags = ["--no-sandbox", "--disable-gpu"]
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
        yield chromium
        chromium.close()


def opened(browser, lab, name):
    """The notebook in a window so high that all of its cells are drawn."""
    tab = browser.new_page(viewport={"width": 1200, "height": 12000})
    tab.set_default_timeout(60_000)
    tab.goto(f"{lab}/tree/{name}?reset")
    cells = json.loads((ROOT / "notebooks" / name).read_text())["cells"]
    texts = sum(cell["cell_type"] == "markdown" for cell in cells)
    tab.wait_for_function(DRAWN, arg=texts)
    tab.wait_for_selector('.jp-Notebook-ExecutionIndicator[data-status="idle"]')
    return tab


def run_all(tab):
    """Run > Run All Cells, then wait until the kernel has nothing to do."""
    tab.click("text=Run >> nth=0")
    tab.click("text=Run All Cells >> nth=0")
    tab.wait_for_function(
        """() => [...document.querySelectorAll('.jp-CodeCell .jp-InputPrompt')]
            .every(prompt => /\\[\\d+\\]/.test(prompt.textContent))""",
        timeout=120_000,
    )


def test_a_chapter_runs_and_nothing_in_it_is_raw(browser, lab):
    tab = opened(browser, lab, CHAPTER)
    words = "\n".join(tab.locator(".jp-RenderedMarkdown").all_inner_texts())
    assert len(words) > 2000
    assert not RAW.findall(words)
    assert RAW.findall(":::{note}")
    run_all(tab)
    assert tab.locator('.jp-OutputArea-output[data-mime-type*="stderr"]').count() == 0
    assert "Traceback" not in tab.inner_text(".jp-Notebook")
    slider = tab.locator('.slam-figure input[type="range"], .jp-OutputArea input[type="range"]')
    slider.first.wait_for()
    before = tab.evaluate(PICTURE)
    slider.first.focus()
    tab.keyboard.press("End")
    tab.wait_for_timeout(500)
    assert tab.evaluate(PICTURE) != before
    tab.close()


def test_an_exercise_says_what_is_missing_and_folds_its_hints(browser, lab):
    tab = opened(browser, lab, f"exercises/{CHAPTER}")
    run_all(tab)
    report = tab.locator(".jp-OutputArea-output", has_text="properties hold").first
    report.wait_for()
    assert "replace the ..." in tab.inner_text(".jp-Notebook").replace("`", "")
    hint = tab.locator(".jp-RenderedMarkdown details").first
    told = hint.locator("p").first
    assert not told.is_visible()
    hint.locator("summary").click()
    assert told.is_visible()
    tab.close()
