"""The version number of a data set's frames: the key `frames_version` of dataset.yaml.

Frames with the same version number have the same bytes for the same scene, LiDAR, preset and seed.
"""

from pathlib import Path

from pyinfra.dataset.frames import data_set_of
from pyinfra.formats.kitti import read_yaml

# Version of simulated frames in pyinfra 0.3 and 0.4, and in files without `frames_version`.
FIRST = "3"
# Name of the column, in tables, with the frames_version of the detector's training frames.
LEARNT = "learnt_frames_version"
NOT_MEASURED = "the accuracy on such frames was not measured"
# End of a warning in commands that measure the accuracy on the frames.
MAY_BE_BETTER = "a detector that learnt from these frames may be more accurate"


def frames_version_of(version: str) -> str:
    """Returns the frames_version of a data set whose dataset.yaml does not have this key.

    The frames_version of data sets of package version 0.3 is "3". For other data sets it is
    unknown. The function then returns the package version, so that only frames of the same package
    version can be compared.
    """
    return FIRST if version.startswith("0.3.") else version


def written_versions(folder: Path) -> tuple[str, str]:
    """Returns frames_version and the package version that wrote the frames of a LiDAR's folder.

    Both are empty if the data set has no dataset.yaml, such as a recording. Raises FormatError.
    """
    file = data_set_of(folder) / "dataset.yaml"
    top = read_yaml(file) if file.is_file() else None
    number, version = (top.maybe(k) if top else None for k in ("frames_version", "version"))
    text = version.text() if version else ""
    return number.text() if number else frames_version_of(text), text


def number_at(folder: Path) -> str:
    """Returns the version number of the simulated frames in a LiDAR's folder, as a text.

    The text is empty for a recording, and for frames of package version 0.2, which have no number.
    """
    number, _ = written_versions(folder)
    return number if number.isdecimal() else ""


def other_frames(name: str, learnt: str, used: str, consequence: str = NOT_MEASURED) -> str:
    """Returns a warning if a model is used on frames of a different frames_version, else "".

    learnt: frames_version of the frames that the model was learnt from, separated by blanks. Both
    are empty for recorded frames, which have no frames_version.
    """
    numbers = learnt.split()
    if not numbers or not used or used in numbers:
        return ""
    listed = " and ".join(numbers)
    return (
        f"{name}: learnt from frames of frames_version {listed}, used on frames of frames_version "
        f"{used}: {consequence}"
    )
