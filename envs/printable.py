"""Text from files and command lines as it may be shown: in one line, and without commands to the terminal."""

from __future__ import annotations


def printable(text: str) -> str:
    """The text with what is not to be printed (line ends, control characters, halves of surrogate pairs, as they stand
    for bytes of file names that are no UTF-8) as its code: ``\\x1b``, ``\\n``, ``\\udcff``.
    """
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)
