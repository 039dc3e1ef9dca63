"""Markup: what is not markup already is text, whatever it holds."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from stages.shared.markup import Markup, filled, joined, markup, script_data

STAGES = Path(__file__).resolve().parents[2] / "stages"
EVIL = ("<b>", "</script>", "<!--", "]]>", '" onload="x', "' x='", "&lt;", "a\0b", "\x1b[31m", "\ud800", "\u202ex")


@pytest.mark.parametrize("text", EVIL)
def test_a_field_is_text_in_an_element_and_in_an_attribute(text: str) -> None:
    made = markup('<p title="{}">{}</p>', text, text)
    element = ElementTree.fromstring(made.encode("utf-8"))
    assert list(element) == [] and list(element.attrib) == ["title"]
    assert element.text == element.attrib["title"]
    if text.isprintable():
        assert element.text == text


def test_markup_and_several_fields_stay_markup() -> None:
    cells = (markup("<td>{}</td>", text) for text in ("a", "<b>"))
    assert markup("<tr>{row}</tr>", row=cells) == "<tr><td>a</td><td>&lt;b&gt;</td></tr>"
    assert joined(["<", markup("<br>"), 3 * ">"], ", ") == "&lt;, <br>, &gt;&gt;&gt;"
    assert markup("{:.1f} {}", 0.25, None) == "0.2 None"


def test_text_made_from_markup_is_text_again() -> None:
    assert not isinstance(markup("<b>") + "<i>", Markup)
    assert markup("{}", markup("<b>") + "<i>") == "&lt;b&gt;&lt;i&gt;"


def test_a_field_is_taken_whole() -> None:
    with pytest.raises(KeyError):
        markup("{0.__class__}", "x")  # type: ignore[misc]
    assert markup("{}", "{0.__class__} $title") == "{0.__class__} $title"


def test_the_places_of_a_page_are_filled_once() -> None:
    page = Markup("<h1>$title</h1>$rest")
    assert filled(page, title="$rest <b>", rest=markup("<p>")) == "<h1>$rest &lt;b&gt;</h1><p>"


@pytest.mark.parametrize("text", EVIL)
def test_data_cannot_end_their_script_element(text: str) -> None:
    made = script_data([{text: text}])
    assert not set(made) & set("<>&") and made.isascii()
    assert json.loads(made) == [{text: text}]


def test_no_other_module_makes_markup() -> None:
    """No f-string holds tags, and `Markup` is called in its own module alone."""
    tag = re.compile(r"</[a-z]|<[a-z][a-z0-9]*(?:\s+[a-z-]+=\"|\s*/>)|<(?:p|b|i|h\d|t[drh]|d[ltd]|li|ul|code|small)>")
    faults = []
    for path in STAGES.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Markup" and path.name != "markup.py":
                faults.append(f"{path}:{node.lineno} calls Markup")
            if isinstance(node, ast.JoinedStr):
                text = "{}".join(str(part.value) for part in node.values if isinstance(part, ast.Constant))
                if tag.search(text):
                    faults.append(f"{path}:{node.lineno} puts fields between tags")
    assert faults == []
