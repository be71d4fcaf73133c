"""Folders depend on each other in one direction only, according to their include and import
lines."""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from pyinfra.cli.main import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
SIMULATOR = ROOT / "cpp/infrasim"
SOURCES = ["*.h", "*.cpp"]

# The folders that a folder of the simulator may include besides itself.
BELOW_PIPELINE = {
    "core": set[str](),
    "io": {"core"},
    "config": {"io", "core"},
    "scene": {"config", "io", "core"},
    "sensor": {"scene", "config", "core"},
    "raycast": {"scene", "config", "core"},
    "filter": {"core"},
}
MAY_INCLUDE = BELOW_PIPELINE | {
    "pipeline": set(BELOW_PIPELINE),
    "cli": {"pipeline", *BELOW_PIPELINE},
}
ALLOWED_FOLDER = {
    "yaml-cpp": "config",
    "embree3": "raycast",
    "embree4": "raycast",
    "pcl": "filter",
}


def sources(folder: Path) -> list[Path]:
    return sorted(path for pattern in SOURCES for path in folder.rglob(pattern))


def includes(path: Path) -> list[str]:
    return re.findall(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]', path.read_text(), re.MULTILINE)


def folder_of(header: str) -> str:
    """Returns the simulator's folder of a header: `config` for `infrasim/config/scene_config.h`."""
    return Path(header).parts[1]


@pytest.mark.parametrize("path", sources(SIMULATOR), ids=lambda p: str(p.relative_to(SIMULATOR)))
def test_simulator_includes_point_downwards(path: Path) -> None:
    folder = folder_of(str(path.relative_to(SIMULATOR.parent)))
    ours = {folder_of(name) for name in includes(path) if name.startswith("infrasim/")}
    assert ours <= MAY_INCLUDE[folder] | {folder}


def test_constants_and_types_of_sources_have_names_of_their_own() -> None:
    """A unity build compiles several sources together. Their number decides which."""
    pattern = r"^(?:const.* (?=k[A-Z])|enum (?:class )?|struct |class )(\w+)(?= *[\[={:])"
    per_file = [
        set(re.findall(pattern, path.read_text(), re.M)) for path in SIMULATOR.rglob("*.cpp")
    ]
    names = Counter(name for names in per_file for name in names)
    assert {name for name, count in names.items() if count > 1} == set()


def test_simulator_includes_its_own_headers_by_their_full_name() -> None:
    for path in sources(SIMULATOR):
        quoted = re.findall(r'#include "([^"]+)"', path.read_text())
        assert all(name.startswith("infrasim/") for name in quoted), path


@pytest.mark.parametrize(("library", "folder"), ALLOWED_FOLDER.items())
def test_library_is_included_in_one_folder_only(library: str, folder: str) -> None:
    users = {
        path.relative_to(ROOT)
        for path in sources(ROOT / "cpp") + sources(ROOT / "bindings")
        if any(name.startswith(f"{library}/") for name in includes(path))
    }
    assert {path for path in users if not path.is_relative_to(f"cpp/infrasim/{folder}")} == set()


def test_pointops_know_nothing_of_the_simulator() -> None:
    for path in sources(ROOT / "cpp/pointops"):
        assert not any(name.startswith("infrasim/") for name in includes(path)), path


def test_no_number_of_the_simulator_is_written_by_the_locale_of_its_process() -> None:
    """Python may have set a locale with a decimal comma. The binary keeps the locale with which it
    starts."""
    by_locale = r"%[-+#0-9.*]*l?[aefgAEFG]|\b(strto[dfl]|sto[dfi]|ato[fi]|setlocale|sscanf)\b"
    files = [*sources(ROOT / "cpp/infrasim"), *sources(ROOT / "bindings")]
    offenders = [
        f"{file.relative_to(ROOT)}: {line.strip()}"
        for file in files
        if file.parent != ROOT / "cpp/infrasim/cli"
        for line in file.read_text().splitlines()
        if re.search(by_locale, line) and not line.lstrip().startswith("//")
    ]
    assert offenders == []


def test_the_simulator_calls_no_function_whose_bits_depend_on_the_processor() -> None:
    """`infrasim/core/math.h` has these functions with equal bits on every processor."""
    call = r"\bstd::(sin|cos|tan|asin|acos|atan2?|exp2?|log(2|10)?|pow|hypot|cbrt|erfc?)\("
    offenders = [
        f"{file.relative_to(ROOT)}: {line.strip()}"
        for file in [*sources(ROOT / "cpp/infrasim"), *sources(ROOT / "bindings")]
        for line in file.read_text().splitlines()
        if re.search(call, line)
    ]
    assert offenders == []


@pytest.mark.parametrize("folder", ["cpp", "bindings", "tests/cpp", "tests/fuzz", "benchmarks"])
def test_every_source_is_built(folder: str) -> None:
    listed = re.findall(r"[\w/]+\.cpp", (ROOT / folder / "CMakeLists.txt").read_text())
    files = (ROOT / folder).rglob("*.cpp")
    assert {str(path.relative_to(ROOT / folder)) for path in files} - set(listed) == set()


def imports(path: Path) -> Iterator[str]:
    """Yields the full names of the modules that a file of pyinfra imports, and of the names in
    them."""
    package = path.relative_to(ROOT).parent.parts
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*above, *(node.module or "").split(".")]).rstrip(".")
            yield module
            yield from (f"{module}.{alias.name}" for alias in node.names)


# The packages of pyinfra by layer, lowest first. A package imports only itself and lower layers.
LAYERS = (
    ("core",),
    ("formats",),
    ("dataset",),
    ("metrics", "scenes"),
    ("exchange", "models", "tracking"),
    ("experiments",),
    ("viz",),
    ("cli",),
)
LAYER_OF = {package: i for i, layer in enumerate(LAYERS) for package in layer}
SHARED_BY_COMMANDS = (
    "arguments", "completion", "main", "messages", "next_command", "number_option", "parser"
)  # fmt: skip
SUBCOMMANDS = ("site",)  # commands with subcommands


def package_of(module: str) -> str | None:
    """Returns the package of a module: `dataset` for `pyinfra.dataset.frames`, None for a module
    outside of pyinfra."""
    top, _, rest = module.partition(".")
    package = rest.split(".")[0]
    return package if top == "pyinfra" and package in LAYER_OF else None


@pytest.mark.parametrize("path", sorted((ROOT / "pyinfra").glob("**/*.py")), ids=lambda p: p.name)
def test_no_import_of_pyinfra_runs_upwards(path: Path) -> None:
    parts = path.relative_to(ROOT / "pyinfra").parts
    if len(parts) == 1:
        return  # pyinfra/__init__.py and __main__.py contain the public API and the command
    importer = parts[0]
    imported = {package for name in imports(path) if (package := package_of(name))}
    assert {p for p in imported - {importer} if LAYER_OF[p] >= LAYER_OF[importer]} == set()


def test_pyinfra_imports_neither_the_study_nor_the_benchmarks() -> None:
    above = {"reproduction", "benchmarks"}
    for path in (ROOT / "pyinfra").rglob("*.py"):
        assert {name.partition(".")[0] for name in imports(path)} & above == set(), path


def test_every_package_has_a_layer() -> None:
    folders = {path.parent.name for path in (ROOT / "pyinfra").glob("*/__init__.py")}
    assert folders == set(LAYER_OF)


def test_only_commands_print() -> None:
    printing = {
        path.relative_to(ROOT / "pyinfra").parts[0]
        for path in (ROOT / "pyinfra").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "print"
    }
    assert printing == {"cli"}


def test_no_circle_of_modules() -> None:
    files = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in (ROOT / "pyinfra").rglob("*.py")
        if path.name not in {"__init__.py", "__main__.py"}
    }
    graph = {name: set(imports(path)) & set(files) - {name} for name, path in files.items()}
    assert list(TopologicalSorter(graph).static_order())


def test_types_of_arrays_have_one_place() -> None:
    files = [path for path in (ROOT / "pyinfra").rglob("*.py") if path.stem != "arrays"]
    assert [path for path in files if re.search(r"^\w+ = .*NDArray", path.read_text(), re.M)] == []


def test_each_command_is_a_module_of_commands() -> None:
    """A subcommand's module is named after the command and the subcommand, such as `site_traffic`
    for `site`."""
    files = {path.stem for path in (ROOT / "pyinfra/cli").glob("*.py")} - {
        "__init__",
        *SHARED_BY_COMMANDS,
    }
    files = {file for file in files if not (set(SUBCOMMANDS) & {file.split("_")[0]} - {file})}
    assert {module for module, _ in COMMANDS.values()} == {f"pyinfra.cli.{f}" for f in files}


def test_commands_import_no_other_command() -> None:
    for path in (ROOT / "pyinfra/cli").glob("*.py"):
        others = {name for name in imports(path) if name.startswith("pyinfra.cli.")}
        shared = [f"pyinfra.cli.{name}" for name in SHARED_BY_COMMANDS]
        allowed = (f"pyinfra.cli.{path.stem}_", *shared)
        assert {name for name in others if not name.startswith(allowed)} == set(), path


def test_only_the_simulator_and_the_kernels_import_the_extension() -> None:
    users = {
        path.relative_to(ROOT / "pyinfra")
        for path in (ROOT / "pyinfra").rglob("*.py")
        if any(name.startswith("pyinfra._core") for name in imports(path))
    }
    simulator = {Path("dataset/simulation.py"), Path("dataset/made.py")}
    assert {p for p in users - simulator if not p.is_relative_to("models/ops")} == set()


def test_evaluation_does_not_import_torch() -> None:
    without = {package for layer in LAYERS[: LAYER_OF["metrics"] + 1] for package in layer}
    for path in (ROOT / "pyinfra").rglob("*.py"):
        if path.relative_to(ROOT / "pyinfra").parts[0] in without:
            assert "torch" not in {name.split(".")[0] for name in imports(path)}, path


def test_hooks_and_environment_have_the_same_versions() -> None:
    hooks = re.findall(r'"([\w-]+==[\w.]+)"', (ROOT / ".pre-commit-config.yaml").read_text())
    assert hooks
    assert set(hooks) <= set((ROOT / "scripts/constraints.txt").read_text().split())


def test_every_version_of_the_environment_has_a_hash() -> None:
    """pip then refuses a package without a hash, and a file that differs from the tested one."""
    text = (ROOT / "scripts/constraints.txt").read_text().replace("\\\n", "")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    hashed = re.compile(r"[\w.-]+==[\w.]+(\s+--hash=sha256:[0-9a-f]{64})+")
    assert lines
    assert [line for line in lines if not hashed.fullmatch(line)] == []


# these files contain a command that repeats a result
ANSWERS = {"dataset/card.py", "experiments/stress/trials.py"}
PROGRAMS = {"scenes/maps/netconvert.py"}  # this file contains options of SUMO


def test_no_text_of_the_library_names_an_option_of_a_command() -> None:
    """A message names the argument. The command replaces it by its option (cli/messages.py)."""
    matches = []
    for path in sorted((ROOT / "pyinfra").rglob("*.py")):
        name = path.relative_to(ROOT / "pyinfra").as_posix()
        if not name.startswith("cli/") and name not in ANSWERS | PROGRAMS:
            matches += [(name, text) for text in texts(path) if re.search(OPTION, text)]
    words = [text for _, text in matches if re.fullmatch(r"--[a-z][\w.-]*(=\{\})?", text)]
    assert [(name, text) for name, text in matches if text not in words] == []


OPTION = r"(?<![\w(-])--[a-z]"  # does not match var(--ink) of a style sheet


def texts(path: Path) -> Iterator[str]:
    """Yields the string literals of a file, with `{}` in place of values."""
    parts = set[int]()
    nodes = list(ast.walk(ast.parse(path.read_text())))
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            parts |= {id(part) for part in node.values}
            yield "".join(
                str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values
            )
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts:
            yield node.value
