"""The student's feedback page in a browser: on a phone, and in the dark."""

import shutil

import numpy as np
import pytest

from slamlab.commands._page import png_of
from slamlab.commands._submission import Mark
from slamlab.commands.grade import feedback
from slamlab.exercises.ch02_kalman_filter import check_predict

sync_api = pytest.importorskip("playwright.sync_api")
CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Debian's chromium")
SEEN = """() => ({
  wide: document.documentElement.scrollWidth,
  picture: document.querySelector("img").getBoundingClientRect().width,
  first: Math.max(...[...document.querySelectorAll("tr td:first-child")].map((td) => {
    const text = document.createRange();
    text.selectNodeContents(td);
    return text.getBoundingClientRect().height;
  })),
  paper: getComputedStyle(document.body).backgroundColor,
  ink: getComputedStyle(document.body).color,
})"""


def page_of_a_mistake():
    def wrong(mean, cov, u, dt, sigma):
        return check_predict.reference(mean, np.diag(np.diag(cov)), u, dt, sigma)

    report = check_predict.judge(check_predict.observe(wrong))
    mark = Mark("a_very_long_name_that_a_file_may_have_02_kalman_filter", "02")
    mark.reports["predict"], mark.notes = report, ["predict: " + "word " * 40]
    mark.pictures["predict"] = png_of(check_predict.draw(wrong))
    return feedback(mark, ["predict", "update"])


def test_a_feedback_page_is_read_on_a_phone_and_in_the_dark():
    page, seen = page_of_a_mistake(), {}
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        for scheme in ("light", "dark"):
            context = browser.new_context(
                viewport={"width": 390, "height": 800}, color_scheme=scheme
            )
            tab = context.new_page()
            tab.set_content(page)
            seen[scheme] = tab.evaluate(SEEN)
        browser.close()
    for one in seen.values():
        assert one["wide"] <= 390, "nothing but pictures scrolls sideways"
        assert one["picture"] >= 540, "its labels are at least 9 pixels high"
        assert one["first"] < 40, "ok and NO are not broken"
    assert seen["light"]["paper"] == "rgb(255, 255, 255)"
    assert sum(map(int, seen["dark"]["paper"][4:-1].split(", "))) < 100
    assert sum(map(int, seen["dark"]["ink"][4:-1].split(", "))) > 600
