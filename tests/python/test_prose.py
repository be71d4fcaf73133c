"""README and docs are written in short sentences with few numbers."""

import prose
import pytest

# maximum share of long sentences, and of sentences with many numbers
MOST_LONG = MOST_NUMERIC = 1 / 50
LEAST_MEDIAN = 9  # words in the median sentence
LEAST_WORDS = 12_000
README_WORDS = 450
# The page of version 0.2 is replaced by pages of results, and is not measured.
REPLACED = "verdicts_0.2.md"


def test_pages_have_short_sentences_with_few_numbers() -> None:
    pages = [page for page in prose.pages() if page.name != REPLACED]
    of_all = prose.measure([page.read_text(encoding="utf-8") for page in pages])
    count = len(of_all.sentences)
    assert len(of_all.long) <= MOST_LONG * count, of_all.long
    assert len(of_all.numeric) <= MOST_NUMERIC * count, of_all.numeric
    assert of_all.median >= LEAST_MEDIAN
    assert of_all.words >= LEAST_WORDS


def test_readme_is_one_screen() -> None:
    readme, *_ = prose.pages()
    assert prose.measure([readme.read_text(encoding="utf-8")]).words <= README_WORDS


@pytest.mark.parametrize(
    ("text", "sentences"),
    [
        ("One. Two: three; four", ["One.", "Two:", "three;", "four"]),
        ("# Head\n\n- item one\n- item\n  two\n", ["item one", "item two"]),
        ("AP is 0.85 at `a.b c` of [a page](x.md#y).", ["AP is 0.85 at code of a page."]),
        ("| a | b |\n|---|---|\n\n```sh\nrun. it\n```\n<!-- no -->\nYes.", ["Yes."]),
        ("![A picture](a.png)\n\n(As said.) Done.", ["(As said.", "Done."]),
    ],
)
def test_markdown_is_split_into_sentences(text: str, sentences: list[str]) -> None:
    assert list(prose.sentences(text)) == sentences


def test_long_and_numeric_sentences_are_listed() -> None:
    measured = prose.measure([f"{'word ' * 31}. From 1 to 2, and from 3 to 4. In 3-D, 1 to 3."])
    assert [len(measured.long), len(measured.numeric)] == [1, 1]
