"""What README and docs/*.md show: commands, files and programs, with what the page says of how they are tried.

A fenced block of `console` has commands behind `$ `. A block of YAML, XML or Python is the file that the paragraph
before it names in backticks, with its ending, as the last one; Python without such a name is a program. Comments
before a block, which readers do not see:

    <!-- not run: WHY -->        cannot be run here (a board, a camera, an installation): its words are checked only
    <!-- tested with: WORDS -->  added to each command of the block, to make it shorter; where the first word is no
                                 option, to `mazeplan` with that word alone (`evaluate --runs 1`); there may be several
    <!-- exit status: 0 or 1 --> what it ends with, if that is not 0
    <!-- after: tour.md -->      goes on where that page's commands ended
    <!-- same as: tour.md -->    is run there, in the same words
"""

from __future__ import annotations

import re
import shlex
import textwrap
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MARKS = ("not run", "tested with", "exit status", "after", "same as")
FENCE = re.compile(r"^( *)```(\w*)[^\n]*\n(.*?)^\1```$", re.DOTALL | re.MULTILINE)
FILE = re.compile(r"`([\w./-]+\.(?:py|ya?ml|xml|csv))`")
ENDINGS = {"python": (".py",), "yaml": (".yaml", ".yml"), "xml": (".xml",), "csv": (".csv",)}


@dataclass(frozen=True)
class Block:
    """A fenced block: page and line where it begins, what it is, what is in it, and what was said of it."""

    page: str
    line: int
    kind: str
    text: str
    marks: dict[str, str] = field(default_factory=dict)
    file: str | None = None

    @property
    def commands(self) -> list[str]:
        """Those behind `$ `."""
        return [row.removeprefix("$ ") for row in self.text.splitlines() if row.startswith("$ ")]

    def tried(self, command: str) -> list[str]:
        """The words with which a command is run here."""
        words = shlex.split(command, comments=True)
        for more in map(shlex.split, self.marks.get("tested with", "").splitlines()):
            if more[0].startswith("-"):
                words += more
            elif words[:2] == ["mazeplan", more[0]]:
                words += more[1:]
        return words

    @property
    def statuses(self) -> set[int]:
        """Exit statuses that are right."""
        return {int(text) for text in self.marks.get("exit status", "0").split(" or ")}


def pages() -> list[str]:
    """README and all pages of docs/, from the root."""
    return ["README.md", *sorted(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md"))]


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def blocks(page: str, text: str | None = None) -> list[Block]:
    """All fenced blocks of a page."""
    text = text_of(page) if text is None else text
    found, end = [], 0
    for match in FENCE.finditer(text):
        before = text[end : match.start()]
        end, kind = match.end(), match[2]
        marks = {}
        for comment in re.findall(r"<!-- (.*?) -->", before):
            name, _, value = comment.partition(": ")
            assert name in MARKS, f"{page}: <!-- {comment} -->: expected one of {', '.join(MARKS)}"
            assert value, f"{page}: <!-- {comment} --> says nothing"
            marks[name] = f"{marks[name]}\n{value}" if name in marks else value
        last = re.sub(r"<!--.*?-->", "", before, flags=re.DOTALL).rstrip().split("\n\n")[-1]
        names = [name for name in FILE.findall(last) if name.endswith(ENDINGS.get(kind, ()) or "no such")]
        line = text.count("\n", 0, match.start()) + 1
        found.append(Block(page, line, kind, textwrap.dedent(match[3]), marks, names[-1] if names else None))
    return found


def beyond_fences(page: str) -> str:
    """The text of a page without its fenced blocks and comments."""
    return re.sub(r"<!--.*?-->", "", FENCE.sub("", text_of(page)), flags=re.DOTALL)
