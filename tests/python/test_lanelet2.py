"""Lanelet2 maps become lanes. The files follow the public description of the format,
https://github.com/fzi-forschungszentrum-informatik/Lanelet2/tree/master/lanelet2_core/doc."""

import math
from pathlib import Path

import numpy as np
import pytest
from conftest import Infrasim

from pyinfra.core.errors import Error
from pyinfra.scenes.maps.map_import import import_map
from pyinfra.scenes.maps.map_readers import ImportOptions
from pyinfra.scenes.maps.openstreetmap import transverse_mercator
from pyinfra.scenes.maps.site_folder import set_duration
from pyinfra.scenes.maps.site_traffic import write_traffic
from pyinfra.scenes.maps.traffic_demand import Demand
from pyinfra.viz.site_plan import read_lanes

CENTRE = (8.4, 49.0)
# Borders at y = 3.5, 0 and -3.5, and a walkway up to y = -6; x from -100 to 100.
YS = (3.5, 0.0, -3.5, -6.0)


def lanelets(
    file: Path, *, local: bool, turned: bool = False, lows: frozenset[int] = frozenset()
) -> Path:
    """Writes a street along x with a lane each way; `turned`: all ways run the other way round.
    Nodes of the ids `lows` have no height."""
    nodes, ways = [], []
    for k, y in enumerate(YS):
        refs = []
        for i, x in enumerate((-100.0, -20.0, 40.0, 100.0)):
            name = 10 * (k + 1) + i
            lon = CENTRE[0] + math.degrees(x / 6.3781e6 / math.cos(math.radians(CENTRE[1])))
            lat = CENTRE[1] + math.degrees(y / 6.3656e6)
            tags = "" if name in lows else f'<tag k="ele" v="{100 + 0.01 * x}"/>'
            if local:
                tags += f'<tag k="local_x" v="{5000 + x}"/><tag k="local_y" v="{y - 700}"/>'
            place = 'lon="" lat=""' if local else f'lon="{lon!r}" lat="{lat!r}"'
            nodes.append(f'<node id="{name}" {place}>{tags}</node>')
            refs.append(f'<nd ref="{name}"/>')
        ways.append(f'<way id="{k + 1}">{"".join(refs[:: -1 if turned else 1])}</way>')
    relations = "".join(
        f'<relation id="{name}"><member type="way" role="left" ref="{left}"/>'
        f'<member type="way" role="right" ref="{right}"/><tag k="type" v="lanelet"/>{more}'
        "</relation>"
        for name, left, right, more in (
            (91, 2, 1, '<tag k="subtype" v="road"/>'),  # to the west
            (92, 2, 3, ""),  # to the east
            (93, 3, 4, '<tag k="subtype" v="walkway"/>'),
            (94, 1, 3, '<tag k="subtype" v="crosswalk"/>'),
        )
    )
    other = '<relation id="95"><tag k="type" v="regulatory_element"/></relation>'
    text = f'<osm version="0.6">{"".join(nodes)}{"".join(ways)}{relations}{other}</osm>'
    file.write_text(text)
    return file


@pytest.mark.parametrize("local", [False, True])
@pytest.mark.parametrize("turned", [False, True])
def test_lanelets_are_lanes_in_their_direction(local: bool, turned: bool, tmp_path: Path) -> None:
    """The sides of the borders decide the direction, not that of their ways."""
    file = lanelets(tmp_path / "a.osm", local=local, turned=turned)
    made = import_map(file, tmp_path / "site", ImportOptions(radius_m=300))
    lanes = read_lanes(tmp_path / "site/lanes.csv")
    assert set(lanes) == {"lanelet_91", "lanelet_92"}
    for name, y, ahead in (("lanelet_91", 1.75, -1), ("lanelet_92", -1.75, 1)):
        x = lanes[name][:, 0]
        assert np.sign(x[-1] - x[0]) == ahead
        assert np.ptp(x) == pytest.approx(200, abs=1)
        assert np.ptp(lanes[name][:, 2]) == pytest.approx(2, abs=0.05)
        assert lanes[name][:, 1].mean() - lanes["lanelet_91"][:, 1].mean() == pytest.approx(
            y - 1.75, abs=0.05
        )
    offset = made["offset_m"]
    assert offset == ([5000, -702, 100] if local else [0, 0, 100])
    assert ("projection" in made) == (not local)
    assert [row["id"] for row in made["features"]["crossing"]] == ["lanelet 94"]
    assert made["not_understood"] == ["regulatory_element: not read, 1 in the file"]


@pytest.mark.parametrize(
    ("lows", "first_z", "words"),
    [
        ({11}, -1.0, "heights of 1 of 16 points: interpolated"),  # in the middle of a border
        ({10}, -0.6, "heights of 1 of 16 points: interpolated"),  # at its end
        ({10, 11, 12, 13}, 0.0, "heights of 12 of 16 points: left out"),
    ],
)
def test_missing_heights_are_not_zero(
    lows: set[int], first_z: float, words: str, tmp_path: Path
) -> None:
    file = lanelets(tmp_path / "a.osm", local=True, lows=frozenset(lows))
    made = import_map(file, tmp_path / "site", ImportOptions(radius_m=300))
    lane = read_lanes(tmp_path / "site/lanes.csv")["lanelet_91"]
    profile = lane[np.argsort(lane[:, 0]), 2]
    assert profile[0] == pytest.approx(first_z, abs=0.01)
    assert np.abs(np.diff(profile)).max() < 0.1
    assert words in made["guessed"][0]


@pytest.mark.parametrize("turned", [False, True])
def test_a_crossing_is_listed_at_its_middle(turned: bool, tmp_path: Path) -> None:
    """The points of the borders, at x = -100, -20, 40 and 100, have another mean."""
    file = lanelets(tmp_path / "a.osm", local=True, turned=turned)
    made = import_map(file, tmp_path / "site", ImportOptions(radius_m=300))
    (row,) = made["features"]["crossing"]
    x, y, _ = made["offset_m"]
    assert (row["x_m"] + x, row["y_m"] + y) == pytest.approx((5000, -700), abs=0.1)


def test_the_test_file_is_in_metres() -> None:
    lon = CENTRE[0] + math.degrees(100 / 6.3781e6 / math.cos(math.radians(CENTRE[1])))
    assert transverse_mercator(np.array([[lon, 49.0]]), CENTRE)[0, 0] == pytest.approx(100, abs=0.5)


def test_a_site_of_lanelets_is_simulated_with_recorded_tracks(
    tmp_path: Path, infrasim: Infrasim
) -> None:
    """SUMO's traffic is refused with the way out."""
    file = lanelets(tmp_path / "a.osm", local=True)
    import_map(file, tmp_path / "site", ImportOptions(radius_m=300))
    with pytest.raises(Error, match=r"a Lanelet2 map has no network.*recorded trajectories"):
        write_traffic(tmp_path / "site", Demand(900), 30, 1)
    rows = "".join(
        f"{k / 10:.1f},1,Car,{-40 + 1.2 * k:.1f},-1.75,0.8,0,4.5,1.8,1.5,12\n" for k in range(60)
    )
    text = f"t,id,class,x,y,z,heading,dx,dy,dz,speed\n{rows}"
    (tmp_path / "site/trajectories.csv").write_text(text)
    set_duration(tmp_path / "site", 5.9)
    infrasim("check", tmp_path / "site/site.yaml", check=True)
