"""What a search engine is told of a page: its first paragraph, not the box before it."""

import sys
from pathlib import Path

from docutils.core import publish_doctree

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "book" / "extensions"))
from page_description import LONGEST, describe, description

CHAPTER = """
Title
=====

  You will be able to do it.

A robot *drives* "off".

More.
"""


def test_the_first_paragraph_describes_a_page_and_no_box():
    assert description(publish_doctree(CHAPTER)) == 'A robot drives "off".'
    assert description(publish_doctree("Title\n=====\n")) == ""


def test_a_long_one_is_cut_between_words():
    said = description(publish_doctree("robot " * 100))
    assert len(said) <= LONGEST
    assert said.endswith("robot ...")


def test_quotes_do_not_end_the_tag_and_other_tags_stay():
    context = {"metatags": "<meta>"}
    describe(None, "page", "", context, publish_doctree(CHAPTER))
    assert context["metatags"].startswith("<meta><meta ")
    assert "drives &quot;off&quot;." in context["metatags"]
