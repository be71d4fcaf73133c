"""The folders depend on each other in one direction only: read off the include and import lines."""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from pyinfra.cli import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
SIMULATOR = ROOT / "cpp/infrasim"
SOURCES = ["*.h", "*.cpp"]

# What a folder of the simulator may include besides itself.
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
ONLY_PLACE = {
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
    """The simulator's folder of `infrasim/config/scene_config.h`: `config`."""
    return Path(header).parts[1]


@pytest.mark.parametrize("path", sources(SIMULATOR), ids=lambda p: str(p.relative_to(SIMULATOR)))
def test_simulator_includes_point_downwards(path: Path) -> None:
    folder = folder_of(str(path.relative_to(SIMULATOR.parent)))
    ours = {folder_of(name) for name in includes(path) if name.startswith("infrasim/")}
    assert ours <= MAY_INCLUDE[folder] | {folder}


def test_constants_and_types_of_sources_have_names_of_their_own() -> None:
    """A unity build compiles sources together, which ones depends on how many there are."""
    pattern = r"^(?:const.* (?=k[A-Z])|enum (?:class )?|struct |class )(\w+)(?= *[\[={:])"
    found = [set(re.findall(pattern, path.read_text(), re.M)) for path in SIMULATOR.rglob("*.cpp")]
    names = Counter(name for names in found for name in names)
    assert {name for name, count in names.items() if count > 1} == set()


def test_simulator_includes_its_own_headers_by_their_full_name() -> None:
    for path in sources(SIMULATOR):
        quoted = re.findall(r'#include "([^"]+)"', path.read_text())
        assert all(name.startswith("infrasim/") for name in quoted), path


@pytest.mark.parametrize(("library", "folder"), ONLY_PLACE.items())
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
    """Python may have set a decimal comma; the binary keeps the locale that it starts with."""
    by_locale = r"%[-+#0-9.*]*l?[aefgAEFG]|\b(strto[dfl]|sto[dfi]|ato[fi]|setlocale|sscanf)\b"
    files = [*sources(ROOT / "cpp/infrasim"), *sources(ROOT / "bindings")]
    found = [
        f"{file.relative_to(ROOT)}: {line.strip()}"
        for file in files
        if file.parent != ROOT / "cpp/infrasim/cli"
        for line in file.read_text().splitlines()
        if re.search(by_locale, line) and not line.lstrip().startswith("//")
    ]
    assert found == []


@pytest.mark.parametrize("folder", ["cpp", "bindings", "tests/cpp", "tests/fuzz", "benchmarks"])
def test_every_source_is_built(folder: str) -> None:
    listed = re.findall(r"[\w/]+\.cpp", (ROOT / folder / "CMakeLists.txt").read_text())
    files = (ROOT / folder).rglob("*.cpp")
    assert {str(path.relative_to(ROOT / folder)) for path in files} - set(listed) == set()


def imports(path: Path) -> Iterator[str]:
    """Full names of the modules, and of the names in them, that a file of pyinfra imports."""
    package = path.relative_to(ROOT).parent.parts
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*above, *(node.module or "").split(".")]).rstrip(".")
            yield module
            yield from (f"{module}.{alias.name}" for alias in node.names)


# The rooms of pyinfra, lowest first: each imports only itself and what stands before it.
ROOMS = (
    *("arrays", "atomic", "boxes", "config"),
    *("kitti", "simulator", "sim", "data", "drawing", "site", "statistics", "evaluation"),
    *("detectors", "training", "sites", "benchmark", "stress", "exchange", "viewer", "report"),
    *("cli", "commands"),
)
EVERYWHERE = {"_core"}
MODULES_AT_THE_TOP = 8
LINES_OF_A_FUNCTION = 60
SUBCOMMANDS = ("site",)  # commands that have some


def room_of(module: str) -> str | None:
    """The room of `pyinfra.data.frames`: `data`; None outside of pyinfra."""
    top, _, rest = module.partition(".")
    room = rest.split(".")[0]
    return room if top == "pyinfra" and (room in ROOMS or room in EVERYWHERE) else None


@pytest.mark.parametrize("path", sorted((ROOT / "pyinfra").glob("**/*.py")), ids=lambda p: p.name)
def test_no_import_of_pyinfra_runs_upwards(path: Path) -> None:
    parts = path.relative_to(ROOT / "pyinfra").with_suffix("").parts
    if parts[0] in {"__init__", "__main__"}:
        return  # the doors of the house
    below = set(ROOMS[: ROOMS.index(parts[0]) + 1]) | EVERYWHERE
    assert {room for name in imports(path) if (room := room_of(name))} <= below


def test_only_commands_print() -> None:
    printing = {
        path.relative_to(ROOT / "pyinfra").parts[0]
        for path in (ROOT / "pyinfra").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "print"
    }
    assert printing == {"cli.py", "commands"}


def rows_of_the_page(title: str) -> list[str]:
    """First cells of the table below a heading of docs/rooms.md."""
    below = (ROOT / "docs/rooms.md").read_text().split(f"## {title}")[1].split("\n## ")[0]
    return re.findall(r"^\| (\w+) \|", below, re.MULTILINE)[1:]


def test_the_page_of_rooms_names_each_in_its_order() -> None:
    assert rows_of_the_page("The package") == list(ROOMS)
    assert rows_of_the_page("The simulator") == list(MAY_INCLUDE)


def test_no_circle_of_modules() -> None:
    files = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in (ROOT / "pyinfra").rglob("*.py")
        if path.name not in {"__init__.py", "__main__.py"}
    }
    graph = {name: set(imports(path)) & set(files) - {name} for name, path in files.items()}
    assert list(TopologicalSorter(graph).static_order())


def test_few_modules_stand_at_the_top() -> None:
    assert len(list((ROOT / "pyinfra").glob("*.py"))) <= MODULES_AT_THE_TOP


def test_types_of_arrays_have_one_place() -> None:
    files = [path for path in (ROOT / "pyinfra").rglob("*.py") if path.stem != "arrays"]
    assert [path for path in files if re.search(r"^\w+ = .*NDArray", path.read_text(), re.M)] == []


def test_each_command_is_a_module_of_commands() -> None:
    """A part of a command with subcommands is named after it: `site_traffic` of `site`."""
    files = {path.stem for path in (ROOT / "pyinfra/commands").glob("*.py")} - {"__init__"}
    files = {file for file in files if not (set(SUBCOMMANDS) & {file.split("_")[0]} - {file})}
    assert {command.module for command in COMMANDS} == {f"pyinfra.commands.{f}" for f in files}


def test_a_class_has_a_name_of_its_own() -> None:
    """But for `Config`, by which each detector's file is asked for its own."""
    trees = [ast.parse(path.read_text()) for path in (ROOT / "pyinfra").rglob("*.py")]
    names = [node.name for tree in trees for node in tree.body if isinstance(node, ast.ClassDef)]
    assert {name for name, count in Counter(names).items() if count > 1} == {"Config"}


@pytest.mark.parametrize("folder", ["pyinfra", "scripts", "benchmarks"])
def test_no_function_is_longer_than_60_lines(folder: str) -> None:
    long = [
        f"{path.relative_to(ROOT)}:{node.lineno}: {node.name}"
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef)
        and (node.end_lineno or 0) - node.lineno >= LINES_OF_A_FUNCTION
    ]
    assert long == []


def test_commands_import_no_other_command() -> None:
    for path in (ROOT / "pyinfra/commands").glob("*.py"):
        others = [name for name in imports(path) if name.startswith("pyinfra.commands")]
        assert all(name.startswith(f"pyinfra.commands.{path.stem}_") for name in others), path


def test_only_the_simulator_and_the_kernels_import_the_extension() -> None:
    users = {
        path.relative_to(ROOT / "pyinfra")
        for path in (ROOT / "pyinfra").rglob("*.py")
        if any(name.startswith("pyinfra._core") for name in imports(path))
    }
    allowed = Path("detectors/ops")
    assert {p for p in users if p != Path("sim.py") and not p.is_relative_to(allowed)} == set()


def test_evaluation_does_not_import_torch() -> None:
    below = ROOMS[: ROOMS.index("evaluation") + 1]
    for path in (ROOT / "pyinfra").rglob("*.py"):
        if path.relative_to(ROOT / "pyinfra").with_suffix("").parts[0] in below:
            assert "torch" not in {name.split(".")[0] for name in imports(path)}, path


def test_hooks_and_environment_have_the_same_versions() -> None:
    hooks = re.findall(r'"([\w-]+==[\w.]+)"', (ROOT / ".pre-commit-config.yaml").read_text())
    assert hooks
    assert set(hooks) <= set((ROOT / "scripts/constraints.txt").read_text().split())


def test_every_version_of_the_environment_has_a_hash() -> None:
    """pip then refuses a package without one, and a file that is not the one that was tested."""
    text = (ROOT / "scripts/constraints.txt").read_text().replace("\\\n", "")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    hashed = re.compile(r"[\w.-]+==[\w.]+(\s+--hash=sha256:[0-9a-f]{64})+")
    assert lines
    assert [line for line in lines if not hashed.fullmatch(line)] == []
