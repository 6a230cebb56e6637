"""A report's Markdown as one page of HTML that needs nothing but itself: pictures are in it, and nothing is loaded."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

from markdown_it import MarkdownIt
from markdown_it.token import Token

from freemesh_ray.statistics.verdict import Verdict
from freemesh_ray.storage.atomic import replacing

#: What writes the pages, as they name it.
GENERATOR = "freemesh report"
#: Kinds of picture, the better first.
MEDIA = {".svg": "image/svg+xml", ".png": "image/png"}
#: Tokens that are text, as it is.
TEXT = ("text", "text_special", "code_inline")
_MARKDOWN = MarkdownIt("commonmark", {"html": False, "xhtmlOut": False}).enable("table")
_SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)
_PLACE = re.compile(r"\{\{(\w+)\}\}")


def write(path: Path, text: str, pictures: Path) -> None:
    """Write the page of a report; the same text and pictures give the same bytes.

    Args:
        path: of the HTML file.
        text: in Markdown, as the report has it; HTML in it stays text.
        pictures: folder of the pictures that it names.

    Raises:
        OutputError: the place cannot be written to.
    """
    with replacing(path) as draft:
        draft.write_text(page(text, pictures), encoding="utf-8")


def page(text: str, pictures: Path, *, generator: str = GENERATOR, layout: str = "report", home: str = "") -> str:
    """The page.

    Args:
        text: in Markdown.
        pictures: folder of the pictures that it names.
        generator: what the page says that it was made by.
        layout: ``report`` or ``index``, a class of its style.
        home: address of the page of all studies; empty: none.
    """
    tokens = _MARKDOWN.parse(text)
    headings = _name_headings(tokens)
    _frame_tables(tokens)
    _put_pictures(tokens, pictures)
    first = next((i for i, token in enumerate(tokens) if token.type == "heading_open" and token.tag == "h2"), None)
    opening, body = tokens[:first], tokens[first:] if first else []
    template = files("freemesh_ray.report").joinpath("page.html").read_text(encoding="utf-8")
    script = _SCRIPT.search(template)
    assert script is not None
    digest = base64.b64encode(hashlib.sha256(script[1].encode()).digest()).decode()
    values = {
        "title": escape(_title(tokens)),
        "generator": escape(generator),
        "script_digest": digest,
        "layout": layout,
        "home": f'<p class="home"><a href="{escape(home)}">All studies</a></p>' if home else "",
        "opening": _rendered(opening),
        "contents": _contents(headings),
        "body": _rendered(body),
    }
    return _PLACE.sub(lambda found: values[found[1]], template)


def _rendered(tokens: Sequence[Token]) -> str:
    return _MARKDOWN.renderer.render(tokens, _MARKDOWN.options, {}).strip()


def _plain(inline: Token) -> str:
    """The text of a line without its markup."""
    return "".join(token.content for token in inline.children or () if token.type in TEXT)


def _title(tokens: Sequence[Token]) -> str:
    """The text of the first heading."""
    return next((_plain(after) for token, after in zip(tokens, tokens[1:], strict=False) if token.tag == "h1"), "")


def _name_headings(tokens: Sequence[Token]) -> list[tuple[int, str, str]]:
    """Give every heading below the title an id; their level, id and text."""
    found: list[tuple[int, str, str]] = []
    taken: set[str] = set()
    for token, after in zip(tokens, tokens[1:], strict=False):
        if token.type == "heading_open" and token.tag != "h1":
            told = _plain(after)
            name = stem = re.sub(r"[^a-z0-9]+", "-", told.lower()).strip("-") or "section"
            number = 1
            while name in taken:
                number += 1
                name = f"{stem}-{number}"
            taken.add(name)
            token.attrSet("id", name)
            found.append((int(token.tag[1]), name, told))
    return found


def _contents(headings: Sequence[tuple[int, str, str]]) -> str:
    """The table of contents; empty without headings."""
    if not headings:
        return ""
    lines = [f'<li class="level{level}"><a href="#{name}">{escape(told)}</a></li>' for level, name, told in headings]
    return "\n".join(
        ['<nav aria-label="Contents">', "<details open>", "<summary>Contents</summary>", "<ol>", *lines, "</ol>",
         "</details>", "</nav>"]
    )  # fmt: skip


def _frame_tables(tokens: list[Token]) -> None:
    """Let wide tables scroll by themselves, and make the first column's cells headers of their rows."""
    heading, first, row_header = "", False, False
    for i, token in enumerate(tokens):
        if token.type == "heading_open":
            heading = _plain(tokens[i + 1])
        elif token.type == "table_open":
            token.meta["heading"] = heading
        elif token.type == "tr_open":
            first = True
        elif token.type in ("th_open", "td_open"):
            if "right" in str(token.attrs.pop("style", "")):
                token.attrSet("class", "right")
            row_header = token.type == "td_open" and first
            if row_header:
                token.tag = "th"
            if token.tag == "th":
                token.attrSet("scope", "row" if row_header else "col")
            first = False
        elif token.type == "td_close" and row_header:
            token.tag = "th"
        if token.type == "td_open":
            _mark_verdict(tokens[i + 1])
    places = [i for i, token in enumerate(tokens) if token.type in ("table_open", "table_close")]
    for i in reversed(places):
        if tokens[i].type == "table_close":
            tokens.insert(i + 1, _html("</div>\n"))
        else:
            name = escape(tokens[i].meta["heading"])
            tokens.insert(i, _html(f'<div class="table" role="region" aria-label="Table: {name}" tabindex="0">\n'))


def _mark_verdict(cell: Token) -> None:
    """Give a verdict in bold its class."""
    children = cell.children or []
    for opening, told in zip(children, children[1:], strict=False):
        if opening.type == "strong_open" and told.content in set(Verdict):
            opening.attrSet("class", f"verdict {Verdict(told.content).name.lower()}")


def _put_pictures(tokens: list[Token], folder: Path) -> None:
    """Put pictures in place of the paragraphs that name them; several in one are a gallery."""
    for i, token in enumerate(tokens):
        images = [child for child in token.children or [] if child.type == "image"]
        if images:
            tag = "figure" if len(images) == 1 else "div"
            tokens[i - 1] = _html("<figure>\n" if len(images) == 1 else '<div class="gallery">\n')
            tokens[i] = _html("\n".join(_image(image, folder) for image in images) + "\n")
            tokens[i + 1] = _html(f"</{tag}>\n")


def _image(image: Token, folder: Path) -> str:
    """The picture in the page itself, as SVG where there is one."""
    named = folder / Path(str(image.attrs["src"])).name
    path = next(found for suffix in MEDIA if (found := named.with_suffix(suffix)).is_file())
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<img src="data:{MEDIA[path.suffix]};base64,{data}" alt="{escape(_alternative(image))}">'


def _alternative(image: Token) -> str:
    return "".join(child.content for child in image.children or () if child.type in TEXT)


def _html(text: str) -> Token:
    return Token("html_block", "", 0, content=text)
