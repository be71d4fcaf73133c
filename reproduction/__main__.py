"""Runs `python -m reproduction COMMAND ...`; the commands are modules of reproduction.commands.

Words such as `FRAMES='0:200:20'` after the command replace constants of its module. They are for
short trials, and the column `command` of the results does not have them.
"""

import argparse
import ast
import importlib
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from pyinfra.cli.messages import message_of
from pyinfra.core.errors import Error
from reproduction import ROOT, commands

PROGRAM = "python -m reproduction"
CONSTANT = re.compile(r"([A-Z][A-Z_]*)=(.*)")


def summaries() -> dict[str, str]:
    """Returns the first line of each command's docstring by command name."""
    files = sorted(Path(commands.__path__[0]).glob("[a-z]*.py"))
    texts = {file.stem: ast.get_docstring(ast.parse(file.read_text("utf-8"))) for file in files}
    return {name: (text or "").partition("\n")[0] for name, text in texts.items()}


def without_constants(module: ModuleType, words: Sequence[str]) -> list[str]:
    """Sets a constant of a module for each word NAME=VALUE; returns the other words.

    VALUE is an expression that may use the names of the module. Raises Error for an unknown NAME.
    """
    others = []
    for word in words:
        match = CONSTANT.fullmatch(word)
        if match is None:
            others.append(word)
        elif not hasattr(module, match[1]):
            raise Error(
                f"{word}: expected the name of a constant of {module.__name__}, got {match[1]}"
            )
        else:
            setattr(module, match[1], eval(match[2], vars(module)))
    return others


def main(words: Sequence[str] | None = None) -> int:
    """Runs a command with the words after its name; returns the exit code.

    Raises SystemExit for --help and for wrong usage.
    """
    words = sys.argv[1:] if words is None else words
    sentences = summaries()
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description="Commands:\n" + "\n".join(f"  {n:<16}{text}" for n, text in sentences.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "command", choices=sentences, metavar="COMMAND", help="a command of the list above"
    )
    name = parser.parse_args(words[:1]).command
    sys.path.insert(0, str(ROOT / "tests/python"))  # some commands use the tests' maps
    try:
        module = importlib.import_module(f"reproduction.commands.{name}")
        sys.argv = [f"{PROGRAM} {name}", *without_constants(module, words[1:])]
        return int(module.main() or 0)
    except (Error, OSError) as error:
        print(f"{PROGRAM} {name}: {message_of(error)}", file=sys.stderr)
        return error.exit_code if isinstance(error, Error) else 1


if __name__ == "__main__":
    sys.exit(main())
