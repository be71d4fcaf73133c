"""The AP that fine-tuning adds to the pretrained detector, which differs between LiDARs."""

from collections.abc import Iterable, Mapping

from pyinfra.experiments.planner.detectability import read_detectability
from pyinfra.experiments.result_tables import PRETRAINED


def measured_gains() -> dict[str, float]:
    """Returns the measured gain in AP from fine-tuning the pretrained detector, by LiDAR."""
    return read_detectability("generalist").gains


def caveat(lidars: Iterable[str], gains: Mapping[str, float]) -> str:
    """Returns a remark that the pretrained detector is not equally good for all LiDARs.

    gains: AP that fine-tuning adds, for each LiDAR for which it was measured. If `gains` is empty,
    the text is empty.
    """
    names = list(dict.fromkeys(lidars))
    if not gains:
        return ""
    known = [f"{gains[name]:g} for {name}" for name in names if name in gains]
    others = [name for name in names if name not in gains]
    measured = f"; measured with preset datasheet, AP: {', '.join(known)}" if known else ""
    unknown = f"; not measured for {', '.join(others)}" if others else ""
    return (
        "The pretrained detector is not equally good for all LiDARs: fine-tuning adds more AP to "
        f"LiDARs with few lines or a narrow view{measured}{unknown}."
    )


def caveat_of_results(pairs: Iterable[tuple[str, str]]) -> str:
    """Returns the caveat for results of the pretrained detector with several LiDARs, else "".

    pairs: LiDAR and detector of each result
    """
    lidars = list(dict.fromkeys(lidar for lidar, detector in pairs if detector == PRETRAINED))
    return caveat(lidars, measured_gains()) if len(lidars) > 1 else ""
