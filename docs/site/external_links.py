"""Lists all external links of the site in `external_links.txt`, without opening them."""

from collections import defaultdict
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx

FILE = "external_links.txt"


def write_links(app: Sphinx, error: Exception | None) -> None:
    """Writes one line per external link: the address, and the pages that have it."""
    if error or app.builder.format != "html":
        return
    pages = defaultdict[str, set[str]](set)
    for page in sorted(app.env.found_docs):
        for link in app.env.get_doctree(page).findall(nodes.reference):
            address = link.get("refuri", "")
            if address.startswith(("http://", "https://")):
                pages[address].add(page)
    lines = [f"{address}\t{' '.join(sorted(pages[address]))}\n" for address in sorted(pages)]
    Path(app.outdir, FILE).write_text("".join(lines))


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("build-finished", write_links)
    return {"parallel_read_safe": True}
