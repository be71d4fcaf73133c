"""Full disks, folders of other runs, signals and kills: a frame is complete or does not exist."""

import errno
import os
import random
import re
import resource
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pyinfra.cli import main
from pyinfra.core.files import new_folder, replacing

ROOT = Path(__file__).resolve().parents[2]
BINARY = Path(sys.executable).with_name("infrasim")
COMPANIONS = {"label_2": "txt", "calib": "txt", "objects": "csv", "fields": "bin"}
LIDARS = ["helios_16", "livox_avia"]
FRAMES = 150

Infrasim = Callable[..., Any]
Words = Callable[..., list[str]]
Digests = Callable[[Path], dict[str, str]]


def assert_frames_are_whole(folder: Path, reference: Path) -> int:
    """Checks that each .bin has its other files, with the bytes of an undisturbed run. Returns the
    number of .bin files."""
    bins = sorted(folder.glob("*/training/velodyne/[0-9]*.bin"))
    for bin_file in bins:
        whole = reference / bin_file.relative_to(folder)
        assert bin_file.stat().st_size == whole.stat().st_size, bin_file
        for kind, ending in COMPANIONS.items():
            companion = bin_file.parents[1] / kind / f"{bin_file.stem}.{ending}"
            whole = reference / companion.relative_to(folder)
            assert companion.stat().st_size == whole.stat().st_size, companion
    return len(bins)


def assert_one_line(result: Any, *words: str) -> None:
    assert result.returncode == 1, (result.returncode, result.stderr)
    assert len(result.stderr.splitlines()) == 1, result.stderr
    for word in words:
        assert word in result.stderr, result.stderr


def temporary_files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob(".*") if path.is_file())


@pytest.fixture(scope="module")
def long_command(run_command: Words) -> Words:
    """Returns a command that takes some seconds with one thread."""

    def words(out: Path) -> list[str]:
        return [*run_command(*LIDARS, frames=f"0:{FRAMES}", threads=1, out=out), "--fields"]

    return words


@pytest.fixture(scope="module")
def undisturbed(
    infrasim: Infrasim, long_command: Words, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    out = tmp_path_factory.mktemp("undisturbed") / "out"
    result = infrasim(*long_command(out))
    assert result.returncode == 0, result.stderr
    assert temporary_files(out) == []
    return out


# Disks and folders


def limited(size: int) -> Callable[[], None]:
    """Returns a function for a child process that limits the size of its files."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def test_memory_that_is_too_small_is_said(infrasim: Infrasim, tmp_path: Path) -> None:
    words = ["pattern", "ruby_plus", "--frames", "0:200", "--out", tmp_path / "rays.npy"]
    size = 600_000_000  # bytes; the rays alone need twice as much
    result = infrasim(
        *words, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (size, size))
    )
    assert_one_line(result, "not enough memory")
    assert list(tmp_path.iterdir()) == []


def short(*lidars: str) -> list[str]:
    """Returns options of a run with a small trajectories.csv."""
    files = [f"configs/lidars/{name}.yaml" for name in lidars]
    return ["--lidar", *files, "--set", "duration_s=1", "--set", "traffic.warm_up_s=1"]


def test_file_that_may_not_grow_ends_the_run_with_whole_frames(
    infrasim: Infrasim, digests: Digests, tmp_path: Path
) -> None:
    words = ["run", "configs/scenes/highway.yaml", "--preset", "paper", "--frames", "0:4"]
    words += [*short("helios_16", "ruby_plus"), "--fields", "--threads", "1"]
    whole, out = tmp_path / "whole", tmp_path / "out"
    assert infrasim(*words, "--out", whole).returncode == 0
    sizes = {p: p.stat().st_size for p in whole.rglob("*") if p.is_file()}
    limit = 200_000  # bytes; between the sizes of the .bin files of the two LiDARs
    assert max(s for p, s in sizes.items() if "ruby_plus" not in str(p)) < limit
    result = infrasim(*words, "--out", out, preexec_fn=limited(limit))
    assert_one_line(result, str(out / "ruby_plus"), "can't be written", "File too large")
    assert assert_frames_are_whole(out, whole) == 1
    assert temporary_files(out) == []
    assert infrasim(*words, "--out", out).returncode == 0
    assert digests(out) == digests(whole)


@pytest.mark.parametrize("limit", [0, 100, 1000, 5000])
def test_run_that_can_not_claim_its_folder_leaves_no_half_file(
    limit: int, infrasim: Infrasim, tmp_path: Path, run_command: Words, digests: Digests
) -> None:
    out, whole = tmp_path / "out", tmp_path / "whole"
    result = infrasim(*run_command(frames="0:1", out=out), preexec_fn=limited(limit))
    assert_one_line(result, str(out), "can't be written", "File too large")
    assert infrasim(*run_command(frames="0:1", out=whole)).returncode == 0
    assert digests(out).items() <= digests(whole).items()
    assert infrasim(*run_command(frames="0:1", out=out)).returncode == 0
    assert digests(out) == digests(whole)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Mounts a file system of 2 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(words, capture_output=True).returncode != 0:
        pytest.skip("a file system of its own needs root and the right to mount")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_full_disk_ends_the_run_with_whole_frames(
    small_disk: Path, infrasim: Infrasim, long_command: Words, undisturbed: Path
) -> None:
    out = small_disk / "out"
    result = infrasim(*long_command(out))
    assert_one_line(result, str(out), "can't be written", "No space left")
    frames = assert_frames_are_whole(out, undisturbed)
    assert 0 < frames < 2 * FRAMES
    assert temporary_files(out) == []
    again = infrasim(*long_command(out))
    assert_one_line(again, str(out), "No space left")
    assert assert_frames_are_whole(out, undisturbed) >= frames


@pytest.fixture(scope="module")
def perfect(motorway: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Returns a LiDAR's folder with a split, and predictions for its frames."""
    data = tmp_path_factory.mktemp("perfect") / "data"
    shutil.copytree(motorway, data)
    folder, pred = data / "helios_16", data / "pred"
    pred.mkdir()
    for file in sorted((folder / "training/label_2").iterdir()):
        lines = file.read_text().splitlines()
        (pred / file.name).write_text("".join(f"{line} 0.9\n" for line in lines))
    return folder, pred


COMMANDS = {
    **{
        name: ["export", "{gt}", "--to", name, "--out", "{out}/a"]
        for name in ("openpcdet", "mmdet3d", "pcd", "nuscenes", "openlabel", "mcap")
    },
    "import": ["import", "{gt}", "--from", "kitti", "--out", "{out}/a/pole"],
    "evaluate": ["evaluate", "{gt}", "{pred}", "--out", "{out}"],
    "statistics": ["statistics", "{data}", "--out", "{out}"],
    "pictures": ["pictures", "{data}", "--out", "{out}"],
    "view": ["view", "{gt}", "--out", "{out}/a.html"],
    "train": ["train", "background", "{gt}", "--out", "{out}/a"],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk_is_named_with_the_file_by_every_command_of_pyinfra(
    name: str,
    perfect: tuple[Path, Path],
    small_disk: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    gt, pred = perfect
    if name == "train":
        (gt / "ImageSets").mkdir(exist_ok=True)
        (gt / "ImageSets/train.txt").write_text("000000\n000001\n")
    with (small_disk / "filling").open("wb") as filling:
        filling.write(bytes(2 * 2**20 - 2 * 4096))  # two memory pages are left
    words = {"gt": gt, "pred": pred, "data": gt.parent, "out": small_disk}
    assert main.main([word.format(**words) for word in COMMANDS[name]]) == 1
    message = capsys.readouterr().err.splitlines()[-1]
    assert re.match(rf"pyinfra: {small_disk}/[\w./-]+: No space left on device", message)
    path = message.split(": ")[1]
    assert not any(part.startswith(".") for part in Path(path).parts), message
    assert Path(path).suffix or name == "nuscenes", message


def test_an_error_of_the_system_names_what_was_to_be_written(tmp_path: Path) -> None:
    full = OSError(errno.ENOSPC, "No space left on device")
    with pytest.raises(OSError, match="No space") as error, replacing(tmp_path / "a.txt"):
        raise full
    assert error.value.filename == str(tmp_path / "a.txt")
    with pytest.raises(FileNotFoundError) as missing, new_folder(tmp_path / "b") as beside:
        (beside / "c/d.txt").write_text("")
    assert missing.value.filename == str(tmp_path / "b/c/d.txt")
    with pytest.raises(FileNotFoundError) as other, replacing(tmp_path / "a.txt"):
        (tmp_path / "nowhere").read_text()
    assert other.value.filename == str(tmp_path / "nowhere")
    with pytest.raises(OSError, match="3 requested") as odd, replacing(tmp_path / "a.txt"):
        raise OSError("3 requested and 0 written")
    assert odd.value.filename == str(tmp_path / "a.txt")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("words", [["check", "configs/scenes/highway.yaml"], ["run"]])
def test_results_that_can_not_be_printed_are_an_error(words: list[str], run_command: Words) -> None:
    words = run_command(frames="0:1") if words == ["run"] else words
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(
            [str(BINARY), *words], cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert_one_line(result)


def test_folder_without_the_right_to_write(infrasim: Infrasim, run_command: Words) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o555)
        other_user = {"user": "nobody", "group": "nogroup", "extra_groups": []}
        options = other_user if os.geteuid() == 0 else {}
        result = infrasim(*run_command(out=folder / "out"), **options)
        assert_one_line(result, str(folder / "out"), "can't be created", "Permission denied")
        folder.chmod(0o755)
        (folder / "out").mkdir(mode=0o555)
        (folder / "out").chmod(0o555)
        result = infrasim(*run_command(out=folder / "out"), **options)
        assert_one_line(result, str(folder / "out"), "Permission denied")
        assert list((folder / "out").iterdir()) == []


def test_file_where_a_folder_should_be(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    not_a_folder = "expected a folder, got a file"
    assert_one_line(infrasim(*run_command(out=file)), f"{file}: {not_a_folder}")
    assert_one_line(infrasim(*run_command(out=file / "below")), f"{file}: {not_a_folder}")
    assert file.read_text() == "mine"
    out = tmp_path / "out"
    out.mkdir()
    (out / "helios_16").write_text("mine")
    result = infrasim(*run_command(out=out))
    assert_one_line(result, f"{out / 'helios_16'}: {not_a_folder}")


@pytest.mark.parametrize("command", ["run", "pattern", "trajectories"])
def test_single_file_that_can_not_be_written(
    command: str, infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    file = tmp_path / "nowhere/file"
    words = {
        "run": run_command(summary=file),
        "pattern": ["pattern", "configs/lidars/helios_16.yaml", "--out", file],
        "trajectories": [
            *("trajectories", "configs/scenes/highway.yaml", "--out", file),
            *("--set", "duration_s=1"),
        ],
    }
    assert_one_line(infrasim(*words[command]), str(file), "can't be written", "No such file")


# Folders of another run


@pytest.fixture(scope="module")
def finished(
    infrasim: Infrasim, run_command: Words, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    out = tmp_path_factory.mktemp("finished") / "out"
    assert infrasim(*run_command(frames="0:2", out=out)).returncode == 0
    return out


@pytest.mark.parametrize(
    ("options", "differs"),
    [
        (["--seed", "2"], ["seed: 1", "seed: 2"]),
        (["--aggregation", "slices:5"], ['aggregation: "exact"', 'aggregation: "slices:5"']),
        (["--detail", "box"], ["detail: low", "detail: box"]),
        (["--labels", "all"], ["labels: hit", "labels: all"]),
        (["--fields"], ["fields: false", "fields: true"]),
        (["--set", "traffic.warm_up_s=6"], ["warm_up_s: 5", "warm_up_s: 6"]),
        (["--set", "mounts.pole.z_m=7"], ["z_m: 6", "z_m: 7"]),
    ],
)
def test_folder_of_another_configuration(
    options: list[str],
    differs: list[str],
    finished: Path,
    infrasim: Infrasim,
    run_command: Words,
    digests: Digests,
) -> None:
    before = digests(finished)
    result = infrasim(*run_command(frames="0:4", out=finished), *options)
    assert_one_line(
        result, f"{finished}/dataset.yaml:", "another run", *differs, "; use another folder"
    )
    assert digests(finished) == before


def test_folder_of_another_preset(
    finished: Path, infrasim: Infrasim, run_command: Words, digests: Digests
) -> None:
    before = digests(finished)
    result = infrasim(*run_command(frames="0:4", preset="equal", out=finished))
    assert_one_line(result, f"{finished}/dataset.yaml:", 'preset: "paper"', 'preset: "equal"')
    assert digests(finished) == before


@pytest.mark.parametrize(
    "file", ["dataset.yaml", "trajectories.csv", "roads.csv", "helios_16/lidar.yaml"]
)
def test_folder_whose_files_are_of_other_frames_or_another_source(
    file: str, finished: Path, infrasim: Infrasim, run_command: Words, digests: Digests
) -> None:
    old = (finished / file).read_text()
    lines = old.splitlines(keepends=True)
    number = next((i for i, line in enumerate(lines) if line.startswith("frames_version")), 3)
    lines[number] = "frames_version: 0\n"
    (finished / file).write_text("".join(lines))
    before = digests(finished)
    try:
        result = infrasim(*run_command(frames="0:4", out=finished))
        if file == "dataset.yaml":
            wanted = ["frames_version: expected 4, got 0", "another folder"]
        elif file == "trajectories.csv":
            wanted = ["(row)", "frames_version: 0"]
        else:
            wanted = ["another run", "frames_version: 0"]
        assert_one_line(result, f"{finished / file}:", *wanted)
        assert digests(finished) == before
    finally:
        (finished / file).write_text(old)


def test_folder_takes_more_frames_and_more_lidars_of_the_same_run(
    infrasim: Infrasim, run_command: Words, digests: Digests, tmp_path: Path
) -> None:
    out, whole = tmp_path / "out", tmp_path / "whole"
    assert infrasim(*run_command("helios_16", frames="0:1", out=out)).returncode == 0
    assert infrasim(*run_command("livox_avia", frames="1:3", out=out)).returncode == 0
    assert infrasim(*run_command(*LIDARS, frames="0:3", out=out)).returncode == 0
    assert infrasim(*run_command(*LIDARS, frames="0:3", out=whole)).returncode == 0
    assert digests(out) == digests(whole)


# Signals


def start(words: list[str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [str(BINARY), *words], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def wait_for_frames(folder: Path, count: int) -> None:
    end = time.monotonic() + 60
    while len(list(folder.glob("*/training/velodyne/[0-9]*.bin"))) < count:
        assert time.monotonic() < end, "no frames"
        time.sleep(0.002)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signal_stops_after_the_frame_and_the_same_command_resumes(
    number: signal.Signals,
    code: int,
    infrasim: Infrasim,
    long_command: Words,
    undisturbed: Path,
    digests: Digests,
    tmp_path: Path,
) -> None:
    out = tmp_path / "out"
    process = start(long_command(out))
    wait_for_frames(out, 20)
    process.send_signal(number)
    sent = time.monotonic()
    _, message = process.communicate(timeout=60)
    assert time.monotonic() - sent < 2
    assert process.returncode == code
    assert len(message.splitlines()) == 1, message
    assert "resume" in message
    assert 20 <= assert_frames_are_whole(out, undisturbed) < 2 * FRAMES
    assert temporary_files(out) == []
    assert not (out / "summary.csv").exists()
    assert infrasim(*long_command(out)).returncode == 0
    assert digests(out) == digests(undisturbed)


def catches(process: int, number: int) -> bool:
    """Returns whether a running process has a handler for the signal."""
    status = Path(f"/proc/{process}/status").read_text()
    mask = next(line.split()[1] for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(mask, 16) >> (number - 1) & 1)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize(
    "words",
    [
        ["run", "highway", "--lidar", "helios_16", "--frames", "0:1"],
        ["check", "highway"],
        ["trajectories", "highway", "--out", "trajectories.csv"],
    ],
    ids=lambda words: words[0],
)
def test_signal_before_the_first_frame(
    words: list[str], number: int, code: int, tmp_path: Path
) -> None:
    words = [str(tmp_path / w) if w.endswith(".csv") else w for w in words]
    long = ["--set", "traffic.warm_up_s=10000", "--set", "traffic.vehicles_per_km_lane=100"]
    process = start([*words, *long])
    while not catches(process.pid, number):
        time.sleep(0.01)
    time.sleep(0.3)  # the warm-up takes many times this long
    process.send_signal(number)
    output, message = process.communicate(timeout=10)
    assert (process.returncode, output) == (code, "")
    assert message == f"stopped by signal {number}; the same command resumes\n"
    assert not (tmp_path / "trajectories.csv").exists()


@pytest.mark.nightly
def test_kills_at_random_moments_leave_whole_frames_and_a_folder_that_resumes(
    infrasim: Infrasim,
    long_command: Words,
    undisturbed: Path,
    digests: Digests,
    tmp_path: Path,
) -> None:
    seed = int(os.environ.get("FAULTS_SEED", secrets.randbits(32)))
    print(f"FAULTS_SEED={seed}")
    moments = random.Random(seed)
    out = tmp_path / "out"
    frames = kills = 0
    while kills < 20:
        process = start(long_command(out))
        # Every third kill comes while the process claims the folder or computes the first frame.
        if kills % 3:
            wait_for_frames(out, min(frames + 1, 2 * FRAMES))
        end = time.monotonic() + moments.uniform(0, 0.05)
        while time.monotonic() < end:
            # a reader sees only complete frames meanwhile
            assert_frames_are_whole(out, undisturbed)
        process.kill()
        process.communicate(timeout=60)
        now = assert_frames_are_whole(out, undisturbed)
        assert now >= frames
        frames = now
        # on a fast machine the run has already ended, so the test starts again
        if process.returncode == 0:
            shutil.rmtree(out)
            frames = 0
        else:
            assert process.returncode == -signal.SIGKILL
            kills += 1
    print(f"{frames} of {2 * FRAMES} frames after {kills} kills")
    result = infrasim(*long_command(out))
    assert result.returncode == 0, result.stderr
    assert temporary_files(out) == []
    assert digests(out) == digests(undisturbed)


# Two runs at the same time


def twins(out: Path, run_command: Words) -> list[subprocess.Popen[str]]:
    words = [*run_command(*LIDARS, frames="0:40", threads=1, out=out), "--fields"]
    return [start(words) for _ in range(2)]


@pytest.fixture(scope="module")
def lone(infrasim: Infrasim, run_command: Words, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("lone") / "out"
    command = [*run_command(*LIDARS, frames="0:40", threads=1, out=out), "--fields"]
    assert infrasim(*command).returncode == 0
    return out


@pytest.mark.parametrize("attempt", range(4))
def test_two_equal_runs_at_once_fill_one_folder(
    attempt: int, lone: Path, run_command: Words, digests: Digests, tmp_path: Path
) -> None:
    processes = twins(tmp_path / "out", run_command)
    messages = [process.communicate(timeout=120)[1] for process in processes]
    assert [process.returncode for process in processes] == [0, 0], messages
    assert digests(tmp_path / "out") == digests(lone)
    assert temporary_files(tmp_path / "out") == []


def test_a_run_goes_on_beside_one_that_is_killed(
    lone: Path, run_command: Words, digests: Digests, infrasim: Infrasim, tmp_path: Path
) -> None:
    seed = int(os.environ.get("FAULTS_SEED", secrets.randbits(32)))
    print(f"FAULTS_SEED={seed}")
    moments = random.Random(seed)
    for attempt in range(6):
        out = tmp_path / str(attempt)
        killed, other = twins(out, run_command)
        if attempt % 2:
            wait_for_frames(out, 1)
        time.sleep(moments.uniform(0, 0.1))
        killed.kill()
        killed.communicate(timeout=60)
        _, message = other.communicate(timeout=120)
        assert other.returncode == 0, message
        mine = {k: v for k, v in digests(out).items() if not Path(k).name.startswith(".")}
        assert mine == digests(lone)
        command = [*run_command(*LIDARS, frames="0:40", threads=1, out=out), "--fields"]
        # the files that the killed run left behind are removed
        assert infrasim(*command).returncode == 0
        assert digests(out) == digests(lone)
