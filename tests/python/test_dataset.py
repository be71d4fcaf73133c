"""`python -m reproduction dataset` makes the whole data set, here at a small size."""

import re
import subprocess
from pathlib import Path

import pandas as pd
import pytest
import yaml

from pyinfra.dataset import catalogue
from pyinfra.dataset.split import VAL_FROM_S
from pyinfra.formats import kitti
from reproduction import __main__ as reproduction
from reproduction import data_release
from reproduction.data_card import PLANTS

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Makes two frames of three scenes and four LiDARs."""
    out = tmp_path_factory.mktemp("data") / "paper"
    assert reproduction.main(["dataset", "--frames", "2", "--out", str(out)]) == 0
    return out


def sha256sum(folder: Path) -> subprocess.CompletedProcess[str]:
    words = ["sha256sum", "--quiet", "--strict", "-c", "SHA256SUMS"]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("count", "expected", "step"),
    [(5000, 5000, 1), (500, 500, 10), (100, 100, 50), (3000, 2500, 2), (3, 3, 2499), (2, 2, 4999)],
)
def test_frames_are_spread_over_the_whole_scene(count: int, expected: int, step: int) -> None:
    frames = data_release.spread(count)
    assert (frames[0], len(frames), frames.step) == (0, expected, step)


def test_any_number_of_frames_can_be_split() -> None:
    for count in range(2, 5001):
        frames = data_release.spread(count)
        assert count / 2 < len(frames) <= count
        assert frames[-1] * 0.1 > VAL_FROM_S


@pytest.mark.parametrize("count", ["1", "5001"])
def test_wrong_number_of_frames_is_one_line(count: str, tmp_path: Path, capsys) -> None:
    out = tmp_path / "data"
    assert reproduction.main(["dataset", "--frames", count, "--out", str(out)]) == 2
    assert capsys.readouterr().err == (
        f"python -m reproduction dataset: frames: expected 2 to 5000, got {count}\n"
    )
    assert not out.exists()


def test_wrong_preset_is_one_line_and_writes_nothing(tmp_path: Path, capsys) -> None:
    out = tmp_path / "data"
    words = ["dataset", "--preset", "best", "--frames", "2", "--out", str(out)]
    assert reproduction.main(words) == 2
    assert "expected paper, equal, datasheet, got unknown preset 'best'" in capsys.readouterr().err
    assert not out.exists()


def test_every_scene_and_lidar_is_there_and_split(made: Path) -> None:
    for scene in catalogue.SCENES:
        for lidar in catalogue.LIDARS:
            folder = made / scene / lidar
            assert kitti.frames(folder) == [0, 4999]
            assert (folder / "ImageSets/train.txt").read_text() == "000000\n"
            assert (folder / "ImageSets/val.txt").read_text() == "004999\n"


def test_sha256sum_accepts_the_list_and_finds_a_changed_byte(made: Path) -> None:
    listed = {line.split("  ")[1] for line in (made / "SHA256SUMS").read_text().splitlines()}
    files = {str(file.relative_to(made)) for file in made.rglob("*") if file.is_file()}
    assert files - listed == {"SHA256SUMS", *(f"{scene}/summary.csv" for scene in catalogue.SCENES)}
    assert sha256sum(made).returncode == 0
    label = made / "curve/ruby_plus/training/label_2/004999.txt"
    text = label.read_text()
    try:
        label.write_text(text.replace("0", "1", 1))
        assert sha256sum(made).stdout == "curve/ruby_plus/training/label_2/004999.txt: FAILED\n"
    finally:
        label.write_text(text)


def test_card_has_the_figures_of_the_frames(made: Path) -> None:
    card = (made / "DATASET.md").read_text()
    for scene in catalogue.SCENES:
        labels = [
            line.split()[0]
            for file in sorted((made / scene).glob("*/training/label_2/*.txt"))
            for line in file.read_text().splitlines()
        ]
        counts = pd.Series(labels).value_counts().sort_index()
        text = ", ".join(f"{name} {count:,}" for name, count in counts.items())
        assert f"| {scene} | 1 | 1 | {text} |" in card
        for lidar in catalogue.LIDARS:
            sizes = [f.stat().st_size for f in (made / scene / lidar).glob("training/velodyne/*")]
            (row,) = re.findall(rf"^\| {scene} \| {lidar} \|.*$", card, re.MULTILINE)
            assert row.split(" | ")[4] == f"{sum(sizes) / 16 / 2:,.1f}"
    for needed in ("CC-BY-4.0", "--preset paper --frames 2", "seed 1", "sha256sum"):
        assert needed in card
    assert max(map(len, card.splitlines())) < 200


def test_card_has_vegetation_only_where_the_scenes_have_it() -> None:
    for scene in catalogue.SCENES:
        keys = yaml.safe_load(catalogue.scene_file(scene).read_text())
        presets = {name for name, block in keys["presets"].items() if "vegetation" in block}
        without = {name for name, text in PLANTS.items() if "no vegetation" in text}
        assert ("vegetation" in keys, presets) == (False, set(PLANTS) - without)


def test_stopped_run_goes_on_to_the_same_sums(made: Path) -> None:
    before = (made / "SHA256SUMS").read_text()
    (made / "SHA256SUMS").unlink()
    (made / "DATASET.md").unlink()
    (made / "curve/helios_16/training/velodyne/004999.bin").unlink()
    kept = made / "highway/ruby_plus/training/velodyne/000000.bin"
    written = kept.stat().st_mtime_ns
    data_release.write(made, data_release.spread(2), "paper")
    assert (made / "SHA256SUMS").read_text() == before
    assert kept.stat().st_mtime_ns == written


def test_folder_with_other_frames_is_refused_and_stays(made: Path) -> None:
    before = (made / "SHA256SUMS").read_text()
    with pytest.raises(ValueError, match=r"highway/\w+: expected .*got frame 4999"):
        data_release.write(made, data_release.spread(3), "paper")
    assert (made / "SHA256SUMS").read_text() == before


def test_make_passes_its_choices_on() -> None:
    words = ["make", "--dry-run", "dataset", "FRAMES=500", "PRESET=equal"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "-m reproduction dataset --frames 500 --preset equal --out data/equal" in done.stdout


def test_a_split_that_the_user_made_is_not_overwritten(made: Path) -> None:
    file = made / "highway/ruby_plus/ImageSets/train.txt"
    before = file.read_text()
    file.write_text("004999\n")
    try:
        with pytest.raises(FileExistsError, match="got a different split"):
            data_release.write(made, data_release.spread(2), "paper")
        assert file.read_text() == "004999\n"
    finally:
        file.write_text(before)
        data_release.write(made, data_release.spread(2), "paper")
