"""The words of a Gmsh script, and a place among them that may go back: loops and macros read theirs again."""

from __future__ import annotations

import re
from typing import NamedTuple

from envs.types import DomainError

TOKEN = re.compile(
    r"""(?P<space>\s+|//[^\n]*|/\*.*?(?:\*/|(?P<open>\Z)))
      | (?P<text>"[^"]*"|'[^']*')
      | (?P<number>(?:\d+(?:\.(?!\.\.)\d*)?|\.\d+)(?:[eE][+-]?\d+)?)
      | (?P<name>[A-Za-z_]\w*)
      | (?P<sign>\.\.\.|\+\+|--|\+=|-=|\*=|/=|==|!=|<=|>=|<<|>>|&&|\|\||::|[-+*/%^(){}\[\],;:=.<>!&|?~\#@$])""",
    re.VERBOSE | re.DOTALL | re.ASCII,
)

#: Words read at most beyond one for each letter of the file: those that loops and macros read again.
MOST_REPEATED = 1_000_000


class NotReadError(DomainError):
    """A script that is sound for all we know, and says something that is not read here."""


class Token(NamedTuple):
    """A word of the script: its kind (a group of ``TOKEN``, or ``end``), its text, its line and where it begins."""

    kind: str
    text: str
    line: int
    at: int


class Mark(NamedTuple):
    """A place in a file: the file's text and what messages call it, an offset and its line."""

    text: str
    file: str
    at: int
    line: int


class Words:
    """A place among the words of a script, spaces and comments left out; behind the last come ones of kind ``end``.

    Attributes:
        source: the name that messages begin with.
        file: the included file that is being read, empty in the script itself.
        next: the next word.
    """

    def __init__(self, text: str, source: str) -> None:
        self.source = source
        self._left = len(text) + MOST_REPEATED
        self.jump(Mark(text, "", 0, 1))

    def mark(self) -> Mark:
        """The place before the next word."""
        return Mark(self._text, self.file, self.next.at, self.next.line)

    def jump(self, mark: Mark) -> None:
        """Go to a place."""
        self._text, self.file, self._at, self._line = mark
        self.next = self._read()

    def enter(self, mark: Mark) -> None:
        """Go to the beginning of another file, whose words may be read once more."""
        self._left += len(mark.text)
        self.jump(mark)

    def fault(self, what: str, line: int | None = None) -> DomainError:
        """The error for what is wrong on a line, without one at the next word."""
        return DomainError(f"{self.where(line)}: {what}")

    def where(self, line: int | None = None) -> str:
        """How messages name a line."""
        included = f"{self.file}, " if self.file else ""
        return f"{self.source}: {included}line {line or self.next.line}"

    def take(self) -> Token:
        """The next word, passed."""
        token, self.next = self.next, self._read()
        return token

    def taken(self, text: str) -> bool:
        """Whether the next word is this one; then it is passed."""
        if self.next.text != text or self.next.kind in ("text", "end"):
            return False
        self.take()
        return True

    def expect(self, text: str) -> None:
        """Pass a word that must come here."""
        if not self.taken(text):
            raise self.fault(f"{self.next.text[:40]!r} where {text!r} is needed; correct the statement")

    def skip_statement(self) -> None:
        """Pass everything to the statement's end: its semicolon, or the brace that closes a block of statements."""
        open_braces, block = 0, False
        while (token := self.take()).kind != "end":
            open_braces += (token.text == "{") - (token.text == "}")
            if open_braces <= 0 and (token.text == ";" or (token.text == "}" and block)):
                return
            block = block or token.text == ";"

    def skip_to(self, endings: tuple[str, ...], opening: str = "") -> str:
        """Pass everything up to one of the words that end a block, blocks of the same kind inside it too.

        Args:
            endings: the words, the one that closes a block last.
            opening: what opens a block; empty: there are none in each other.

        Returns:
            The word, passed.
        """
        inside = 0
        while (token := self.take()).kind != "end":
            if token.kind != "name":
                continue
            if not inside and token.text in endings:
                return token.text
            inside += (token.text == opening) - (token.text == endings[-1])
        raise self.fault(f"no {endings[-1]!r} to the end of the file; add it")

    def _read(self) -> Token:
        while self._at < len(self._text):
            match = TOKEN.match(self._text, self._at)
            if match is None:
                what = f"{self._text[self._at]!r} is not understood; correct it there"
                raise DomainError(f"{self.where(self._line)}: {what}")
            if match["open"] is not None:
                raise DomainError(f"{self.where(self._line)}: a comment that does not end; close it with */")
            word = match.group()
            token = Token(str(match.lastgroup), word, self._line, self._at)
            self._line += word.count("\n")
            self._at = match.end()
            if match.lastgroup != "space":
                self._left -= 1
                if self._left < 0:
                    raise DomainError(
                        f"{self.where(token.line)}: loops that read more than {MOST_REPEATED:,} words; "
                        "shorten them, or save the mesh from Gmsh as .msh"
                    )
                return token
        return Token("end", "", self._line, self._at)
