"""Options of a command: the parameters of its `main`, with their help from its docstring.

A parameter before `*` is a positional argument, and one after it is an option. The annotation gives
the type: a sequence takes one or more words, and a boolean is a flag. The entry below `Parameters`
is the help. `Annotated` adds keywords of argparse, such as `{"choices": LIDARS}`. The text above
`Parameters` describes the command, by default the text of its module.
"""

import argparse
import functools
import inspect
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from reproduction import add_out, work_folder

EXAMPLE = re.compile(r"\n\n(?=examples?: )")
ENTRY = re.compile(r"^([\w, ]+) : (.*(?:\n +.*)*)", re.MULTILINE)
Work = Annotated[Path, {"type": work_folder}]  # a working folder for simulated frames
# An output file in out/, or out/ itself if the default is Path(). add_out() explains `recorded`.
Out = Annotated[Path, {"recorded": ""}]


def command(main: Callable[..., int | None]) -> Callable[[], int | None]:
    """Decorates `main` of a command, which then reads its arguments from `sys.argv`."""

    @functools.wraps(main)
    def run() -> int | None:
        return main(**vars(_parser_of(main).parse_args()))

    return run


def _parser_of(main: Callable[..., int | None]) -> argparse.ArgumentParser:
    text, _, entries = f"\n{inspect.getdoc(main) or ''}".partition("\nParameters\n")
    description, *example = EXAMPLE.split(
        text.strip() or sys.modules[main.__module__].__doc__ or ""
    )
    parser = argparse.ArgumentParser(description=description, epilog="".join(example))
    helps = dict(ENTRY.findall(entries))
    hints = get_type_hints(main, include_extras=True)
    for name, parameter in inspect.signature(main).parameters.items():
        option = parameter.kind is parameter.KEYWORD_ONLY
        keywords = _keywords(hints[name])
        if "recorded" in keywords:
            add_out(parser, parameter.default.name, f"--{name}", keywords["recorded"])
            continue
        if name in helps:
            keywords["help"] = " ".join(helps[name].split())
        if parameter.default is not parameter.empty:
            keywords |= {"default": parameter.default} | ({} if option else {"nargs": "*"})
        elif option:
            keywords["required"] = True
        parser.add_argument(f"--{name.replace('_', '-')}" if option else name, **keywords)
    return parser


def _keywords(hint: Any) -> dict[str, Any]:
    """Returns the keywords of argparse's `add_argument` that an annotation stands for."""
    if get_origin(hint) is UnionType:  # the hint is a union of a type and None
        (hint, _) = get_args(hint)
    if get_origin(hint) is Annotated:
        return {**_keywords(hint.__origin__), **hint.__metadata__[0]}
    if get_origin(hint) is Sequence:
        return {"nargs": "+", **_keywords(get_args(hint)[0])}
    if get_origin(hint) is Literal:
        return {"choices": get_args(hint)}
    return {"action": "store_true"} if hint is bool else {"type": hint}
