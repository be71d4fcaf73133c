"""Runs the pages of the documentation: all commands of a page in order, in one folder.

Fenced blocks have one of these kinds:
- `sh`: commands. `infrasim`, `pyinfra`, `python`, `cp` and `mkdir` are run. For `make` and
  `scripts/setup.sh`, the target or group must exist. A command that needs a cluster or a GPU is
  only parsed by its own parser. Any other command is an error.
- `python`: is run; all blocks of a page share one namespace. `yaml`: must be valid YAML. If a file
  name follows the language, the block is saved as this file instead.
- `text`: the output of a command, or the content of a folder.

Configurations are made smaller, with fewer frames and bootstrap replicates, before a command is
run. Pages can therefore show the commands that a user would type.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from pyinfra.cli import main

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
KINDS = ("sh", "python", "yaml", "text")
FEW_FRAMES = 20
ELSEWHERE = re.compile(r"--(backend|address) |--device cuda|--precision bfloat16")
LONG = ["-m", "reproduction", "gpu"]  # only its options are read, because it takes minutes
SHELL = re.compile(r"[|&;<>`$*{}]")  # shell syntax that the runner does not support
SMALL = {
    "evaluate": ["--no-figures", "--replicates", "20"],
    "benchmark": ["--jobs", "1"],
    "plan": ["--every", "120", "--heights", "5", "--pitches", "0", "--check-frames", "2"],
}


@dataclass(frozen=True)
class Block:
    """A fenced block. `file` is the name of the file to which its text is saved."""

    kind: str
    file: str
    text: str


def blocks(page: Path) -> list[Block]:
    matches = re.findall(r"^```([^\n]*)\n(.*?)^```$", page.read_text(), re.DOTALL | re.MULTILINE)
    return [Block(*info.partition(" ")[::2], text) for info, text in matches]


def commands(text: str) -> list[str]:
    """Returns the commands of a block without comments, each in one line."""
    lines = text.replace("\\\n", " ").splitlines()
    return [" ".join(line.partition(" #")[0].split()) for line in lines if not is_blank(line)]


def is_blank(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("#")


def run_page(page: Path, infrasim: Callable[..., object]) -> None:
    """Runs a page in the working folder. Raises AssertionError for a block that the runner can't
    run."""
    copy_configs()
    names: dict[str, object] = {"__name__": page.stem}
    for block in blocks(page):
        assert block.kind in KINDS, f"{page.name}: a block of '{block.kind}', not of {KINDS}"
        if block.file:
            Path(block.file).write_text(small_text(block.text, block.file))
        elif block.kind == "sh":
            for command in commands(block.text):
                run(command, infrasim)
        elif block.kind == "python":
            run_python(block.text, page.name, names)
        elif block.kind == "yaml":
            assert yaml.safe_load(block.text)


def run_python(text: str, name: str, names: dict[str, object]) -> None:
    """Runs a Python block as in a notebook. The block can import files that the page has saved."""
    modules, folder = set(sys.modules), str(Path.cwd())
    sys.path.insert(0, folder)
    try:
        exec(compile(text, name, "exec", dont_inherit=True), names)
    finally:
        sys.path.remove(folder)
        for module in set(sys.modules) - modules:
            if Path(f"{module}.py").is_file():
                del sys.modules[module]


def run(command: str, infrasim: Callable[..., object]) -> None:
    """Runs or parses a command. Raises AssertionError for a command that the runner does not
    know."""
    if command == "source .venv/bin/activate":
        return
    assert not SHELL.search(command), f"more than the runner does: {command}"
    program, *words = shlex.split(command)
    if program == "make":
        check_make(words)
    elif program == "scripts/setup.sh":
        assert set(words) <= groups(), command
    elif program in PARSERS:
        PARSERS[program](words)
    elif program == "pyinfra" and ELSEWHERE.search(command):
        main.make_parser(words).parse_args(words)
    elif program == "pyinfra":
        assert main.main(small_words(words)) == 0, command
    elif program == "infrasim":
        result: Any = infrasim(*small_words(words), cwd=Path.cwd())
        assert result.returncode == 0, f"{command}: {result.stderr}"
    elif program == "python":
        words += ["--help"] if words[:3] == LONG else []
        subprocess.run([sys.executable, *words], check=True, timeout=120)
    elif program in ("cp", "mkdir"):
        {"cp": shutil.copy, "mkdir": os.makedirs}[program](*words)
    else:
        raise AssertionError(f"neither run nor parsed: {command}")


def parse_dask(words: list[str]) -> None:
    import importlib

    module = importlib.import_module(f"distributed.cli.dask_{words[0]}")
    module.main.make_context(words[0], words[1:])


def parse_torchrun(words: list[str]) -> None:
    from torch.distributed.run import get_args_parser

    parsed = get_args_parser().parse_args(words)
    assert (parsed.module, parsed.training_script) == (True, "pyinfra"), words
    main.make_parser(parsed.training_script_args).parse_args(parsed.training_script_args)


PARSERS = {"dask": parse_dask, "torchrun": parse_torchrun}


def check_make(words: list[str]) -> None:
    makefile = (ROOT / "Makefile").read_text()
    for word in words:
        name, equals, _ = word.partition("=")
        wanted = rf"\b{name}\b" if equals else rf"^{name}:"
        assert re.search(wanted, makefile, re.MULTILINE), f"make {word}: not in the Makefile"


def groups() -> set[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    packages = (ROOT / "scripts/apt-packages.txt").read_text().splitlines()
    apt = {line.split()[0] for line in packages if line and not line.startswith("#")}
    return {*project["optional-dependencies"], *apt}


def spoken(page: Path) -> Iterator[list[str]]:
    """Yields the words of each command in the sentences of a page: `pyinfra ...`, `infrasim ...` or
    `make ...`."""
    prose = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    for text in re.findall(r"`((?:pyinfra|infrasim|make) [^`]+)`", prose):
        yield text.split()


def small_words(words: list[str]) -> list[str]:
    """Returns the same command with fewer frames and bootstrap replicates."""
    words = [small_word(before, word) for before, word in zip(["", *words], words, strict=False)]
    return [*words, *(extra for extra in SMALL.get(words[0], []))]


def small_word(option: str, word: str) -> str:
    if option in ("--max-frames", "--check-frames"):
        return "2"
    if option == "--frames":
        ends = [int(part) for part in word.split(":")]
        first, last, step = (*ends, 1)[:3]
        return f"{first}:{last}:{max(step, (last - first) // FEW_FRAMES)}"
    return word


def copy_configs() -> None:
    """Copies the configurations of the repository to `configs`, and makes them smaller."""
    shutil.copytree(ROOT / "configs", "configs", dirs_exist_ok=True)
    for file in Path("configs").rglob("*.yaml"):
        file.write_text(small_text(file.read_text(), file.name))


def small_text(text: str, name: str) -> str:
    """Returns a scene, recipe or benchmark that takes less time. Returns the text of any other file
    unchanged."""
    content = yaml.safe_load(text) if name.endswith(".yaml") else None
    if content is None:
        return text
    if "traffic" in content:
        content["traffic"]["warm_up_s"] = 5
    elif "tiers" in content:
        content["tiers"] = dict.fromkeys(content["tiers"], small_tier(content["tiers"]["smoke"]))
    elif "matrix" in content:
        content["frames"] = f"0:5000:{5000 // FEW_FRAMES}"
        block = content["matrix"][0]
        few = {"scenes": 1, "lidars": 2, "detectors": 2}
        content["matrix"] = [block | {key: block[key][:n] for key, n in few.items()}]
    else:
        return text
    return yaml.safe_dump(content, sort_keys=False)


def small_tier(smoke: dict[str, Any]) -> dict[str, Any]:
    """Returns a tier with at most two training steps. A detector that learns nothing has no
    steps."""
    if "learning" not in smoke:
        return smoke
    learning = {"start": smoke["learning"].get("start", ""), "batch": 1}
    return {**smoke, "learning": {**learning, "steps": min(2, smoke["learning"].get("steps", 2))}}
