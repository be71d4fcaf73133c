"""The study: repeats and tests the paper's results, and makes the tables of the documentation.

Run it from the root of a checkout as `python -m reproduction COMMAND ...`. No wheel contains it.
"""

import argparse
from pathlib import Path

from pyinfra.core.version import __version__, machine

ROOT = Path(__file__).resolve().parent.parent
RECORDED = ROOT / "results"  # folder of the committed measurements


def add_out(
    parser: argparse.ArgumentParser, name: str = "", option: str = "--out", recorded: str = ""
) -> None:
    """Adds the option that names the output file or folder; its default is in out/.

    Parsing the option also creates the output's folder. A wrong path is therefore an error before
    any measurement starts.

    Parameters
    ----------
    name : name of a file in out/; empty if the command writes several files into a folder
    option : name of the option
    recorded : path of the committed output, for the help text; default: results/NAME
    """

    def path(text: str) -> Path:
        out = Path(text)
        try:
            (out.parent if name else out).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            reason = f"expected a path that can be written, got {text}: {error.strerror}"
            raise argparse.ArgumentTypeError(reason) from error
        return out

    recorded = recorded or f"results/{name}"
    parser.add_argument(
        option,
        type=path,
        default=str(ROOT / "out" / name),
        help=f"output {'file' if name else 'folder'}; default: out/{name}. To record the "
        f"measurement: {option} {recorded}",
    )


def work_folder(text: str) -> Path:
    """Returns a working folder, and writes the `frames_version` of its frames to a file in it.

    Raises ArgumentTypeError if the folder has frames of another `frames_version`. Such frames, and
    detectors that were trained on them, must not be mixed with the simulator's frames.
    """
    from pyinfra.core.files import write
    from pyinfra.dataset.simulation import frames_version
    from reproduction.frames_number import COLUMN, FIRST

    folder, number = Path(text), str(frames_version())
    file = folder / f"{COLUMN}.txt"
    if file.is_file():
        found = file.read_text().strip()
    else:
        found = str(FIRST) if folder.is_dir() and any(folder.iterdir()) else number
    if found != number:
        raise argparse.ArgumentTypeError(
            f"{folder}: expected frames of {COLUMN} {number}, got {COLUMN} {found}; choose a "
            "different folder"
        )
    folder.mkdir(parents=True, exist_ok=True)
    if not file.is_file():
        write(file, f"{number}\n")
    return folder


def provenance(command: str, frames_version: int | None = None) -> dict[str, object]:
    """Returns the columns that record a row's origin: versions, machine and command.

    command: the command's name and those of its options that affect the result. frames_version:
    that of the frames from which the row is computed; by default that of the simulator.
    """
    from pyinfra.dataset.simulation import frames_version as current

    number = current() if frames_version is None else frames_version
    versions = {"version": __version__, "frames_version": number}
    return {**versions, "machine": machine(), "command": f"python -m reproduction {command}"}
