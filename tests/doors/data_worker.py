"""Spoils one file of a data set after the other, in the Python of a checkout.

    python data_worker.py DATA LIDAR PRED COUNT SEED

Prints a JSON line a mutant: what was done, what each command made of it, and the AP.
"""

from __future__ import annotations

import contextlib
import io
import json
import random
import signal
import sys
import tempfile
import traceback
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import spoil

PATIENCE_S = 20


class Hang(BaseException):
    pass


def on_alarm(*_: object) -> None:
    raise Hang


def command(words: list[str]) -> tuple[str, str]:
    """ok, refused, traceback or hang; and the last line of its messages."""
    from pyinfra.cli.main import main

    err = io.StringIO()
    signal.alarm(PATIENCE_S)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(err):
            code = main(words)
        kind = "ok" if code == 0 else "refused"
    except SystemExit:
        kind = "refused"
    except Hang:
        kind = "hang"
    except BaseException:
        kind, text = "traceback", traceback.format_exc()
        return kind, text.strip().splitlines()[-1]
    finally:
        signal.alarm(0)
    lines = err.getvalue().strip().splitlines()
    return kind, lines[-1] if lines else ""


def ap_of(folder: Path) -> str:
    table = folder / "ap.csv"
    text = table.read_text() if table.is_file() else ""
    table.unlink(missing_ok=True)
    return text


def try_one(data: Path, lidar: str, pred: Path, out: Path) -> dict[str, object]:
    found: dict[str, object] = {}
    words = ["--no-figures", "--draws", "10", "--split", "all"]
    found["evaluate"] = command(
        ["evaluate", "--gt", str(data / lidar), "--pred", str(pred), "--out", str(out), *words]
    )
    found["ap"] = ap_of(out)
    found["validate"] = command(
        ["validate", str(data / lidar), "--pred", str(pred), "--split", "all"]
    )
    return found


def main() -> None:
    data, lidar, pred = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3])
    draw = random.Random(int(sys.argv[5]))
    signal.signal(signal.SIGALRM, on_alarm)
    files = [
        p
        for p in (
            *(data / lidar).rglob("*"),
            *data.glob("*.csv"),
            *data.glob("*.yaml"),
            *pred.glob("*.txt"),
        )
        if p.is_file()
    ]
    kinds: dict[str, list[Path]] = {}
    for file in sorted(files):
        kinds.setdefault(file.parent.name + file.suffix, []).append(file)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        print(json.dumps({"done": "", **try_one(data, lidar, pred, out)}), flush=True)
        for _ in range(int(sys.argv[4])):
            file = draw.choice(kinds[draw.choice(sorted(kinds))])
            raw, poison = file.read_bytes(), False
            if file.suffix == ".bin":
                spoilt, done = spoil.binary(raw, draw)
            else:
                text, done, poison = spoil.text(raw.decode(), draw)
                spoilt = text.encode(errors="surrogateescape")
            file.write_bytes(spoilt)
            try:
                found = try_one(data, lidar, pred, out)
            finally:
                file.write_bytes(raw)
            print(
                json.dumps(
                    {"done": f"{file.relative_to(data.parent)}: {done}", "poison": poison, **found}
                ),
                flush=True,
            )


if __name__ == "__main__":
    main()
