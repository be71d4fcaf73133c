"""The `pyinfra` command: one subcommand for each row of COMMANDS.

Each subcommand is a module with two functions. `add_arguments(parser)` adds the options and an
example as epilog. `run(args)` calls the library, prints the result and returns the exit code.
Messages go to stderr.

`main` turns an exception into one line on stderr and an exit code:

- 0: the command succeeded
- 1: a file could not be read or written, a package is missing, an experiment failed, or a bug
  occurred; the traceback of a bug is saved to a file
- 2: an error that the user can correct (`pyinfra.Error`, wrong usage)
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

RENAMED_OPTIONS = {"--dials": "--severities", "--draws": "--replicates"}
FAILED = 1
WRONG = 2


@dataclass(frozen=True)
class Command:
    """A subcommand. Its module is imported only when the subcommand is used."""

    name: str
    module: str
    summary: str


COMMANDS = (
    Command("pictures", "pyinfra.cli.pictures", "draw frames from above, scenes and close-ups"),
    Command("lidars", "pyinfra.cli.lidars", "list LiDARs: lines, field of view, range, price"),
    Command("site", "pyinfra.cli.site", "make a site from a map, and add traffic to it"),
    Command("sites", "pyinfra.cli.sites", "generate random sites and draw their plans"),
    Command("view", "pyinfra.cli.view", "show frames in 3-D in an HTML file"),
    Command("statistics", "pyinfra.cli.statistics", "compute points per vehicle and more"),
    Command("evaluate", "pyinfra.cli.evaluate", "compute the average precision of predictions"),
    Command("compare", "pyinfra.cli.compare", "compare pole positions and heights"),
    Command("report", "pyinfra.cli.report", "write the results of a benchmark as one HTML page"),
    Command("validate", "pyinfra.cli.validate", "check data sets and predictions"),
    Command("train", "pyinfra.cli.train", "train a detector on frames"),
    Command("detect", "pyinfra.cli.detect", "run a trained detector and measure its latency"),
    Command("stress", "pyinfra.cli.stress", "find the conditions in which detectors fail"),
    Command("onnx", "pyinfra.cli.onnx", "export a dense detector as an ONNX file"),
    Command("benchmark", "pyinfra.cli.benchmark", "measure accuracy, speed and price"),
    Command("recommend", "pyinfra.cli.recommend", "rank LiDARs and detectors within a budget"),
    Command("export", "pyinfra.cli.export", "write frames in other tools' formats"),
    Command("import", "pyinfra.cli.import_", "import a recording as a data set"),
    Command("split", "pyinfra.cli.split", "divide frames into training and validation"),
)


class _Parser(argparse.ArgumentParser):
    """Reports wrong usage in one line, and accepts values such as `-13,5` that begin with `-`."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        # The pattern of argparse matches only a word that is a single negative number. No option
        # begins with a digit, so every word that begins like a negative number is a value.
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        for old, current in RENAMED_OPTIONS.items():
            if f"{old} " in f"{message} ":
                message += f": {old} is called {current} since version 0.4"
        self.exit(WRONG, f"{self.prog}: {message} (see --help)\n")


def make_parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """Returns the parser for a command line.

    Only the subcommand in `words` gets its arguments, so that no other module is imported.
    """
    parser = _Parser(
        prog="pyinfra",
        description="Trains and evaluates detectors on LiDAR frames, and compares LiDARs.",
        epilog="example: pyinfra lidars --preset datasheet",
    )
    parser.add_argument("--version", action="version", version=f"pyinfra {__version__}")
    parser.add_argument(
        "--traceback",
        action="store_true",
        help="show the traceback of an error; give it before COMMAND",
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
    """Runs a command line, by default that of the process, and returns the exit code.

    Raises SystemExit for --help, --version and wrong usage.
    """
    words = sys.argv[1:] if words is None else words
    args = argparse.Namespace(options={})
    try:
        make_parser(words).parse_args(words, args)
        code = int(args.run(args))
        sys.stdout.flush()  # if the pipe was closed, this line raises BrokenPipeError
        return code
    except BrokenPipeError:  # the reading program, such as `head`, has closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt:
        print(
            "pyinfra: interrupted; run the same command again to resume or restart", file=sys.stderr
        )
        return 130
    except Exception as error:
        if "--traceback" in words:
            raise
        text, code = _ended_by(error, words, args)
        print(f"pyinfra: {text}", file=sys.stderr)
        return code


def _ended_by(error: Exception, words: Sequence[str], args: argparse.Namespace) -> tuple[str, int]:
    """Returns the message and the exit code for an error."""
    if isinstance(error, Error):
        return message_of(error, args.options), error.exit_code
    if isinstance(error, OSError) or is_missing_package(error):
        return message_of(error, args.options), FAILED
    return report_bug(error, words), FAILED


def is_missing_package(error: Exception) -> bool:
    """Returns whether the error is a third-party package that is not installed."""
    name = error.name if isinstance(error, ImportError) else None
    return isinstance(error, ModuleNotFoundError) and not str(name).startswith("pyinfra")
