"""The `pyinfra` command: one subcommand for each row of COMMANDS.

Each subcommand is a module with two functions. `add_arguments(parser)`, made by `usage`, adds the
options and an example as epilog. `run(args)` calls the library, prints the result and returns the
exit code. Messages go to stderr.

`main` turns an exception into one line on stderr and an exit code:

- 0: the command succeeded
- 1: a file could not be read or written, a package is missing, an experiment failed, or pyinfra
  has a bug; the traceback of a bug is saved to a file
- 2: an error that the user can correct (`pyinfra.Error`, wrong usage)
- 130: the user interrupted the command
"""

import argparse
import importlib
import os
import sys
from collections.abc import Sequence

from pyinfra.cli.completion import SHELLS, completion_script
from pyinfra.cli.messages import message_of, options_of, report_bug
from pyinfra.cli.next_command import print_next
from pyinfra.cli.parser import Parser, check_options
from pyinfra.core.errors import Error
from pyinfra.core.files import regular_files_only
from pyinfra.core.names import check_utf8
from pyinfra.core.version import __version__

FAILED = 1


# Maps each subcommand to its module, which is imported only when it is used, and a summary.
COMMANDS = {
    "demo": ("pyinfra.cli.demo", "compare four LiDARs at a junction in a minute"),
    "pictures": ("pyinfra.cli.pictures", "draw frames from above, scenes and close-ups"),
    "lidars": ("pyinfra.cli.lidars", "list LiDARs: lines, field of view, range, price"),
    "site": ("pyinfra.cli.site", "make a site from a map, and add traffic to it"),
    "sites": ("pyinfra.cli.sites", "generate random sites and draw their plans"),
    "view": ("pyinfra.cli.view", "show frames in 3-D in an HTML file"),
    "statistics": ("pyinfra.cli.statistics", "compute points per vehicle and more"),
    "evaluate": ("pyinfra.cli.evaluate", "compute the average precision of predictions"),
    "compare": ("pyinfra.cli.compare", "compare pole positions and heights"),
    "report": ("pyinfra.cli.report", "write the results of a benchmark as one HTML page"),
    "validate": ("pyinfra.cli.validate", "check data sets and predictions"),
    "train": ("pyinfra.cli.train", "train a detector on frames"),
    "detect": ("pyinfra.cli.detect", "run a trained detector and measure its latency"),
    "track": ("pyinfra.cli.track", "join boxes of frames into tracks with speeds"),
    "count": ("pyinfra.cli.count", "count tracks by movement, with speeds and queues"),
    "region": ("pyinfra.cli.region", "propose an outline of the road for a recording"),
    "stress": ("pyinfra.cli.stress", "find the conditions in which detectors fail"),
    "onnx": ("pyinfra.cli.onnx", "export a dense detector as an ONNX file"),
    "benchmark": ("pyinfra.cli.benchmark", "measure accuracy, speed and price"),
    "recommend": ("pyinfra.cli.recommend", "rank LiDARs and detectors within a budget"),
    "plan": ("pyinfra.cli.plan", "choose poles, heights and LiDARs within a budget"),
    "export": ("pyinfra.cli.export", "write frames in other tools' formats"),
    "import": ("pyinfra.cli.import_", "import a recording as a data set"),
    "split": ("pyinfra.cli.split", "divide frames into training and validation"),
}


# The groups of `pyinfra --help`, in the order in which a project uses them.
GROUPS = {
    "Simulate (with infrasim run)": ("lidars", "pictures", "view", "split"),
    "Sites": ("site", "sites"),
    "Detect": ("train", "region", "detect", "onnx"),
    "Count": ("track", "count"),
    "Evaluate": ("statistics", "validate", "evaluate", "stress"),
    "Compare and choose": ("demo", "compare", "benchmark", "recommend", "plan", "report"),
    "Exchange": ("import", "export"),
}


def make_parser(words: Sequence[str], *, whole: bool = False) -> argparse.ArgumentParser:
    """Returns the parser for a command line.

    Only the subcommand in `words` gets its arguments, so that the modules of the other
    subcommands are not imported. whole: whether to add the arguments of all subcommands.
    """
    parser = Parser(
        prog="pyinfra",
        usage="pyinfra [-h] [--version] [--traceback] [--completion SHELL] COMMAND ...",
        description="Trains and evaluates detectors on LiDAR frames, and compares LiDARs.",
        epilog=f"{group_text()}\n\nexample: pyinfra lidars --preset datasheet",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"pyinfra {__version__}")
    parser.add_argument(
        "--traceback",
        action="store_true",
        help="show the traceback of an error; give it before COMMAND",
    )
    parser.add_argument(
        "--completion",
        choices=SHELLS,
        metavar="SHELL",
        help="print a script that completes commands and options in bash or zsh",
    )
    # The epilog lists the commands in groups, so this list of subcommands is hidden by default.
    commands = parser.add_subparsers(
        prog="pyinfra",
        metavar="COMMAND",
        required=True,
        help=None if whole else argparse.SUPPRESS,
    )
    chosen = next((word for word in words if not word.startswith("-")), None)
    for name, (path, summary) in COMMANDS.items():
        sub = commands.add_parser(name, help=summary)
        if whole or name == chosen:
            module = importlib.import_module(path)
            module.add_arguments(sub)
            sub.set_defaults(run=module.run, command=name, options=options_of(sub))
            if name == chosen:
                check_options(sub, words[words.index(chosen) + 1 :])
    return parser


def group_text() -> str:
    """Returns the commands with their summaries, in groups."""
    lines = []
    for title, names in GROUPS.items():
        lines += [f"{title}:", *(f"  {name:<12}{COMMANDS[name][1]}" for name in names), ""]
    return "\n".join(lines[:-1])


def main(words: Sequence[str] | None = None) -> int:
    """Runs a command line, by default that of the process, and returns the exit code.

    Raises SystemExit for --help, --version and wrong usage.
    """
    words = sys.argv[1:] if words is None else words
    args = argparse.Namespace(options={})
    try:
        if words and words[0].startswith("--completion"):
            return print_completion(words)
        for word in words:
            check_utf8(word, "command line")
        make_parser(words).parse_args(words, args)
        with regular_files_only():
            code = int(args.run(args))
        if code == 0:
            print_next(args.command, args)
        sys.stdout.flush()  # raises BrokenPipeError if the pipe was closed
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


def print_completion(words: Sequence[str]) -> int:
    """Prints the script of `--completion SHELL`, which needs no subcommand."""
    shell = words[0].partition("=")[2] or "".join(words[1:2])
    print(completion_script(make_parser([], whole=True), shell))
    return 0


def _ended_by(error: Exception, words: Sequence[str], args: argparse.Namespace) -> tuple[str, int]:
    """Returns the message and the exit code for an error."""
    if isinstance(error, (Error, OSError)) or is_missing_package(error):
        return message_of(error, args.options), getattr(error, "exit_code", FAILED)
    return report_bug(error, words), FAILED


def is_missing_package(error: Exception) -> bool:
    """Returns whether the cause of an error is a third-party package that is not installed."""
    name = error.name if isinstance(error, ImportError) else None
    return isinstance(error, ModuleNotFoundError) and not str(name).startswith("pyinfra")
