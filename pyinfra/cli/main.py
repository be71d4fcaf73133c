"""The `pyinfra` command: one subcommand for each row of COMMANDS.

A command is a module with `add_arguments(parser)`, whose epilog is an example, and
`run(args) -> exit code`: parsing, a call of what a notebook can call too, printing. Messages go to
stderr. What it raises becomes one line and an exit code here: 0 done; 2 what the user can mend
(`pyinfra.Error`, wrong usage); 1 a file that the system cannot read or write, an experiment that
failed, or a bug, whose traceback is kept in a file.
"""

import argparse
import importlib
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

from pyinfra.cli.messages import message_of, options_of, report_bug
from pyinfra.core.errors import Error
from pyinfra.core.version import __version__

FAILED = 1
WRONG = 2


@dataclass(frozen=True)
class Command:
    """A subcommand; its module is imported when it is the one that was asked for."""

    name: str
    module: str
    summary: str


COMMANDS = (
    Command("pictures", "pyinfra.cli.pictures", "a frame from above, the scene, vehicles close up"),
    Command("lidars", "pyinfra.cli.lidars", "the LiDARs there are: lines, view, range, price"),
    Command("site", "pyinfra.cli.site", "a site out of a map and traffic: lanes, plan"),
    Command("sites", "pyinfra.cli.sites", "plausible sites by seed, and their plans"),
    Command("view", "pyinfra.cli.view", "frames in 3-D, as an HTML file without a network"),
    Command("statistics", "pyinfra.cli.statistics", "hits, points per vehicle, patterns"),
    Command("evaluate", "pyinfra.cli.evaluate", "average precision of predictions, with intervals"),
    Command("compare", "pyinfra.cli.compare", "poles and heights over the same traffic, paired"),
    Command("report", "pyinfra.cli.report", "the results as one page that opens from disk"),
    Command("validate", "pyinfra.cli.validate", "checks of data sets and predictions"),
    Command("train", "pyinfra.cli.train", "a detector learns from frames"),
    Command("detect", "pyinfra.cli.detect", "boxes of a trained detector, and its latency"),
    Command("stress", "pyinfra.cli.stress", "where detectors fail, and what fails first"),
    Command("onnx", "pyinfra.cli.onnx", "a dense detector as one ONNX file"),
    Command("benchmark", "pyinfra.cli.benchmark", "accuracy, speed and price, cell by cell"),
    Command("recommend", "pyinfra.cli.recommend", "which LiDAR and detector for a budget"),
    Command("export", "pyinfra.cli.export", "frames for other tools"),
    Command("import", "pyinfra.cli.import_", "other tools' frames as a data set"),
    Command("split", "pyinfra.cli.split", "which frames train and which test"),
)


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line; `-13,5` is a value as `-13` is."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        # Of argparse's own, which knows single numbers only: no option begins with a digit.
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        self.exit(WRONG, f"{self.prog}: {message} (see --help)\n")


def make_parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """The parser for a command line; only the one asked for, the first word, has its arguments."""
    parser = _Parser(
        prog="pyinfra",
        description="Scanning statistics, detectors, average precision and reports.",
        epilog="example: pyinfra lidars --preset datasheet",
    )
    parser.add_argument("--version", action="version", version=f"pyinfra {__version__}")
    parser.add_argument(
        "--traceback", action="store_true", help="before COMMAND: show where an error comes from"
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    asked = next((word for word in words if not word.startswith("-")), None)
    for command in COMMANDS:
        sub = commands.add_parser(command.name, help=command.summary)
        if command.name == asked:
            module = importlib.import_module(command.module)
            module.add_arguments(sub)
            sub.set_defaults(run=module.run, options=options_of(sub))
    return parser


def main(words: Sequence[str] | None = None) -> int:
    """Runs a command line, that of the process by default; returns the exit code.

    Raises SystemExit for --help, --version and wrong usage.
    """
    words = sys.argv[1:] if words is None else words
    args = argparse.Namespace(options={})
    try:
        make_parser(words).parse_args(words, args)
        code = int(args.run(args))
        sys.stdout.flush()  # a closed pipe shows here
        return code
    except BrokenPipeError:  # the reader of a pipe has enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt:
        print("pyinfra: interrupted; the same command goes on, or begins anew", file=sys.stderr)
        return 130
    except Exception as error:
        if "--traceback" in words:
            raise
        text, code = _ended_by(error, words, args)
        print(f"pyinfra: {text}", file=sys.stderr)
        return code


def _ended_by(error: Exception, words: Sequence[str], args: argparse.Namespace) -> tuple[str, int]:
    """What is said of an error, and the exit code."""
    if isinstance(error, Error):
        return message_of(error, args.options), error.exit_code
    if isinstance(error, OSError) or is_missing_package(error):
        return message_of(error, args.options), FAILED
    return report_bug(error, words), FAILED


def is_missing_package(error: Exception) -> bool:
    """Whether a package of others is not installed."""
    name = error.name if isinstance(error, ImportError) else None
    return isinstance(error, ModuleNotFoundError) and not str(name).startswith("pyinfra")
