"""Text from files and command lines as it may be shown: in one line, and without commands to the terminal."""

from __future__ import annotations

import re

#: An address begins behind these three letters, unless it is a file's: ``sqlite:///file``, ``file:///folder``.
AUTHORITY = re.compile("(?<!sqlite)(?<!file)://|://(?!/)", re.IGNORECASE)
WORD = re.compile(r"\S+")


def printable(text: str) -> str:
    """The text with what is not to be printed (line ends, control characters, halves of surrogate pairs, as they stand
    for bytes of file names that are no UTF-8) as its code: ``\\x1b``, ``\\n``, ``\\udcff``.
    """
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def without_login(text: str) -> str:
    """The text with the addresses in it (``http://user:password@host``) without users and passwords.

    Whatever stands before the last ``@`` of a word is a part of them. It takes time with the length of the text.
    """
    return WORD.sub(lambda word: _bare(word[0]), text) if "://" in text and "@" in text else text


def _bare(word: str) -> str:
    end = word.rfind("@")
    begin = AUTHORITY.search(word, 0, end + 1)
    return word[: begin.end()] + word[end + 1 :] if begin else word
