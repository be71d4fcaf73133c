"""The argument parser of `pyinfra`. It reports wrong usage in one line and suggests similar names.

A command declares its arguments: `add_arguments = usage(description, example, argument(...))`.
"""

import argparse
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NoReturn

from pyinfra.core.names import suggestion

Add = Callable[[Any], object]  # adds an argument, or a group of arguments, to a parser
WRONG = 2
NUMBERS = {
    "int": "a whole number, such as 3",
    "float": "a number without a unit or a comma, such as 0.5",
}
MOST_LISTED = 8  # largest number of choices in a message that also suggests a choice

# Maps an option of earlier versions to its replacement. A key that begins with a command only
# applies to this command.
RENAMED = {
    "--dials": "--severities",
    "--draws": "--replicates",
    "benchmark --latency": "--only-latency",
    "detect --data": "DATA first, then --model RUN, as in `pyinfra detect DATA/LIDAR --model RUN`",
    "evaluate --gt": "two folders, as in `pyinfra evaluate DATA/LIDAR PRED`",
    "evaluate --pred": "two folders, as in `pyinfra evaluate DATA/LIDAR PRED`",
    "import --columns": "--point-values",
    "import --labels": "--label-folder",
    "import --model": "--lidar-model",
    "import --scene": "--scene-name",
    "site --mount": "--mount-pose",
    "stress --data": "DATA first, then --model RUN, as in `pyinfra stress DATA/LIDAR --model RUN`",
    "stress --frames": "--max-frames",
    "train --budget": "--step-factor",
    "train --data": "the folders without an option, as in `pyinfra train CONFIG DATA/LIDAR`",
    "train --from": "--start",
    "view --most-points": "--max-points",
}


class Parser(argparse.ArgumentParser):
    """Reports wrong usage in one line, and accepts values such as `-13,5` that begin with `-`.

    An option is only recognised by its full name. Therefore a new option never changes the meaning
    of an existing command line.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.allow_abbrev = False
        # The pattern of argparse only matches a word that is a single negative number. No option
        # begins with a digit, so each word that begins with `-` and a digit is a value.
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        if message.startswith("unrecognized arguments: "):
            extra = message.partition(": ")[2]
            message = f"unexpected '{extra}'; arguments without an option stand before the options"
        message = re.sub(r"^argument ([^:]+): ", r"\1: ", message)
        message = re.sub(r"invalid (\w+) value: (.+)", not_a_number, message)
        self.exit(WRONG, f"{self.prog}: {message} (see --help)\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Raises ArgumentError for a value that is not among the choices.

        The message suggests a similar choice, if there is one.
        """
        choices = [str(choice) for choice in action.choices or ()]
        if choices and str(value) not in choices:
            similar = near(str(value), choices)
            # A long list of choices would hide the suggestion.
            allowed = "a name" if similar and len(choices) > MOST_LISTED else listed(choices)
            raise argparse.ArgumentError(action, f"expected {allowed}, got '{value}'{similar}")


def not_a_number(found: re.Match[str]) -> str:
    """Returns the message for a value that `float` or `int` cannot convert."""
    kind, value = found.groups()
    return f"expected {NUMBERS[kind]}, got {value}" if kind in NUMBERS else found[0]


def check_options(parser: argparse.ArgumentParser, words: Sequence[str]) -> None:
    """Ends the process with a message if `words` have an option that the command does not have.

    Without this check, argparse reports missing arguments before unknown options. Unknown options
    are often the cause of missing arguments.
    """
    command = parser.prog.partition(" ")[2]
    names = [name for action in actions(parser, words) for name in action.option_strings]
    for word in words:
        name = word.partition("=")[0]
        if word == "--":
            return
        if not re.match(r"--[a-zA-Z]", name) or name in names:
            continue
        current = RENAMED.get(f"{command.partition(' ')[0]} {name}") or RENAMED.get(name)
        if current is not None:
            parser.error(f"{name}: renamed in version 0.4; use {current}")
        parser.error(f"{name}: no such option{near(name, names)}")


def actions(
    parser: argparse.ArgumentParser, words: Sequence[str] = ()
) -> Iterator[argparse.Action]:
    """Yields the arguments of a command and of its subcommands.

    If `words` has names of subcommands, only the arguments of these subcommands are included.
    """
    for action in parser._actions:  # the arguments; argparse has no public name for them
        if isinstance(action, argparse._SubParsersAction):
            named = [name for name in action.choices if name in words] or list(action.choices)
            for name in named:
                yield from actions(action.choices[name], words)
        else:
            yield action


def listed(names: Sequence[str]) -> str:
    """Returns names as a text such as `a, b or c`."""
    return " or ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def near(word: str, names: Sequence[str]) -> str:
    """Returns a text such as `; did you mean '--out'?`, or an empty text if no name is similar."""
    text = suggestion(word, names)
    return text if "did you mean" in text else ""


def usage(description: str | None, epilog: str, *arguments: Add) -> Add:
    """Returns a function that adds a description, an example and arguments to a parser."""

    def add(parser: Any) -> None:
        parser.description, parser.epilog = description, epilog
        _add_all(parser, arguments)

    return add


def argument(*names: str, **keywords: Any) -> Add:
    """Returns a function that adds an argument to a parser; it calls `add_argument`."""
    return lambda parser: parser.add_argument(*names, **keywords)


def group(title: str, *arguments: Add) -> Add:
    """Returns a function that adds a group of arguments with a title to a parser."""
    return lambda parser: _add_all(parser.add_argument_group(title), arguments)


def one_of(*arguments: Add) -> Add:
    """Returns a function that adds arguments of which a command line may have only one."""
    return lambda parser: _add_all(parser.add_mutually_exclusive_group(), arguments)


def _add_all(parser: Any, arguments: tuple[Add, ...]) -> None:
    for add in arguments:
        add(parser)
