"""The directive `commands`: the help text of each command of `pyinfra` or `infrasim`."""

import argparse
import os
import re
import subprocess
from collections.abc import Iterator

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from pyinfra.cli import main
from pyinfra.dataset.launch import binary

WIDTH = "88"  # columns of a help text


def parser_helps(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str]]:
    """Yields the program name and the help text of each command below a parser."""
    groups = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if not groups:
        yield parser.prog, parser.format_help()
    for group in groups:
        for command in group.choices.values():
            yield from parser_helps(command)


def pyinfra_helps() -> Iterator[tuple[str, str]]:
    for command in main.COMMANDS:
        parsers = main.make_parser([command])
        (group,) = (a for a in parsers._actions if isinstance(a, argparse._SubParsersAction))
        yield from parser_helps(group.choices[command])


def infrasim_helps() -> Iterator[tuple[str, str]]:
    program = binary()
    assert program, "the simulator is not built: run `make build`"
    listed = output_of(program, "--help").partition("\nSubcommands:\n")[2]
    for name in re.findall(r"^  (\w+)", listed, re.MULTILINE):
        yield f"infrasim {name}", output_of(program, name, "--help")


def output_of(*words: object) -> str:
    command = [str(word) for word in words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


class Commands(SphinxDirective):
    """One section per command of the program in the argument."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        helps = {"pyinfra": pyinfra_helps, "infrasim": infrasim_helps}[self.arguments[0]]
        os.environ["COLUMNS"] = WIDTH  # of argparse
        return [self.section(name, text) for name, text in helps()]

    def section(self, name: str, text: str) -> nodes.section:
        section = nodes.section(ids=[nodes.make_id(name)], names=[name])
        self.state.document.note_explicit_target(section)
        section += nodes.title(name, name)
        block = nodes.literal_block(text, text.strip(), classes=["help"])
        block["language"] = "text"
        section += block
        return section


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True}
