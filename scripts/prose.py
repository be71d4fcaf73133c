"""Measures the sentences of README and docs: length, numbers, words.

    scripts/prose.py [--list] [PAGE ...]

Without a PAGE, README and the pages of docs are measured, without the generated reference and the
decisions. Headings, tables, fenced blocks and comments do not count. Each paragraph and each list
item is split at `.`, `!`, `?`, `;` and `:` before a blank. Code in a sentence counts as one word,
and digits in code do not count as numbers. `--list` prints the sentences that are too long or have
too many numbers.
"""

from __future__ import annotations

import argparse
import re
import statistics
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MOST_WORDS = 30  # maximum number of words of a sentence
MOST_NUMBERS = 3
GENERATED = "reference.md"

NOT_PROSE = re.compile(
    r"^---\n.*?^---$"  # the front matter of a page
    r"|^ *(`{3,}|:{3,}).*?^ *\1$"  # fenced blocks
    r"|<!--.*?-->"
    r"|^ *\|.*?$"  # rows of tables
    r"|^#.*?$"  # headings
    r"|!\[[^]]*\]\([^)]*\)",  # pictures
    re.DOTALL | re.MULTILINE,
)
CODE = re.compile(r"(`+)[^`].*?\1", re.DOTALL)
LINK = re.compile(r"\[([^]]*)\]\([^)]*\)")
PARAGRAPH = re.compile(r"\n\s*\n|^ *(?:[-*+]|\d+\.) ", re.MULTILINE)
SENTENCE = re.compile(r"(?<=[.!?;:])[)*_\"]*(?=\s)")
NUMBER = re.compile(r"(?<![\w.])\d+(?:[.,]\d+)*(?!-D\b)")
WORD = re.compile(r"\w")


@dataclass(frozen=True)
class Prose:
    """The sentences of a text, of which `long` and `numeric` exceed the limits."""

    sentences: list[str]
    long: list[str]
    numeric: list[str]
    words: int
    median: float


def sentences(text: str) -> Iterator[str]:
    """Yields the sentences of a page in Markdown, with `code` in place of code."""
    prose = LINK.sub(r"\1", CODE.sub("code", NOT_PROSE.sub("\n\n", text)))
    for paragraph in PARAGRAPH.split(prose):
        for sentence in SENTENCE.split(paragraph):
            if WORD.search(sentence):
                yield " ".join(sentence.split())


def word_count(sentence: str) -> int:
    return sum(1 for word in sentence.split() if WORD.search(word))


def measure(texts: list[str]) -> Prose:
    """Returns the sentences of several pages together, and which of them exceed the limits."""
    everything = [sentence for text in texts for sentence in sentences(text)]
    counts = [word_count(sentence) for sentence in everything]
    return Prose(
        everything,
        [s for s, n in zip(everything, counts, strict=True) if n > MOST_WORDS],
        [s for s in everything if len(NUMBER.findall(s)) > MOST_NUMBERS],
        sum(counts),
        statistics.median(counts) if counts else 0.0,
    )


def pages() -> list[Path]:
    """Returns README and the pages of docs that are written by hand."""
    docs = sorted((ROOT / "docs").rglob("*.md"))
    return [ROOT / "README.md", *(page for page in docs if is_by_hand(page))]


def is_by_hand(page: Path) -> bool:
    """Returns whether a page is neither generated nor a decision."""
    folders = page.relative_to(ROOT).parts[:-1]
    built = any(folder.startswith(("_", ".")) for folder in folders)
    return not built and "decisions" not in folders and page.name != GENERATED


def line(name: str, prose: Prose) -> str:
    figures = (len(prose.sentences), len(prose.long), len(prose.numeric), prose.median, prose.words)
    return f"{name:32}" + "".join(f"{figure:>11g}" for figure in figures)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("pages", nargs="*", type=Path, metavar="PAGE", help="default: all pages")
    parser.add_argument("--list", action="store_true", help="print sentences beyond the limits")
    arguments = parser.parse_args()
    files = arguments.pages or pages()
    texts = [file.read_text(encoding="utf-8") for file in files]
    heads = ("sentences", "long", "numeric", "median", "words")
    print(f"{'page':32}" + "".join(f"{head:>11}" for head in heads))
    for file, text in zip(files, texts, strict=True):
        prose = measure([text])
        print(line(file.name, prose))
        for sentence in [*prose.long, *prose.numeric] if arguments.list else []:
            print(f"    {sentence}")
    print(line("all", measure(texts)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
