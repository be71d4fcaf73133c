"""Objects, signals and junctions of OpenDRIVE are built at the positions in the map, or are
listed."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import site_data

from pyinfra.scenes.maps.lane_map import MapBody, MapError, SiteMap
from pyinfra.scenes.maps.map_import import import_map
from pyinfra.scenes.maps.opendrive import read_opendrive

BEND = '<arc curvature="0.02"/>'  # turns left around the point 0, 50


def read(folder: Path, more: str, *, shape: str = "<line/>", length: float = 100) -> SiteMap:
    file = folder / "a.xodr"
    road = site_data.road(1, (0, 0, 0), length, shape=shape, more=more)
    file.write_text(site_data.open_drive(road))
    return read_opendrive(file)


def objects(text: str) -> str:
    return f"<objects>{text}</objects>"


def imported(folder: Path, text: str) -> dict[str, Any]:
    pytest.importorskip("sumo", reason="needs the extra `site`")
    (folder / "a.xodr").write_text(text)
    return import_map(folder / "a.xodr", folder / "site")


def radii(bodies: list[MapBody]) -> np.ndarray:
    return np.hypot(*(np.concatenate([b.outline for b in bodies]) - (0, 50)).T)


def test_s_is_the_length_along_a_cubic(tmp_path: Path) -> None:
    """x = 20 p + 80 p^2 has a length of 100 m. Half of the length is reached at x = 50, p =
    0.675."""
    shape = '<paramPoly3 pRange="normalized" bU="20" cU="80"/>'
    house = '<object type="building" id="1" s="50" t="12" length="4" width="4" height="5"/>'
    site_map = read(tmp_path, objects(house), shape=shape)
    np.testing.assert_allclose(site_map.bodies[0].outline.mean(0), (50, 12), atol=0.01)
    assert site_map.not_understood == []
    right = next(lane for lane in site_map.lanes if lane.name == "road1_0_right1")
    np.testing.assert_allclose(
        right.centre[:, 0], np.linspace(0, 100, len(right.centre)), atol=0.01
    )


@pytest.mark.parametrize("range_", ["normalized", "arcLength"])
def test_cubics_of_either_parameter_have_one_speed(tmp_path: Path, range_: str) -> None:
    """Equal steps of s are equal lengths, for any parameter of the cubic."""
    k = 1.0 if range_ == "normalized" else 1 / 40
    b, c, v = 10 * k, 30 * k**2, 5 * k**2
    p = np.linspace(0, 1 / k, 20_001)
    line = np.column_stack([b * p + c * p**2, v * p**2])
    length = float(np.hypot(*np.diff(line, axis=0).T).sum())
    shape = f'<paramPoly3 pRange="{range_}" bU="{b}" cU="{c}" cV="{v}"/>'
    if range_ == "arcLength":
        length = 40.0  # p runs from 0 to the length of the geometry
    site_map = read(tmp_path, "", shape=shape, length=length)
    lane = next(lane for lane in site_map.lanes if lane.name == "road1_0_left1")
    inner = lane.left[:, :2]  # the reference line
    steps = np.hypot(*np.diff(inner, axis=0).T)
    assert steps.std() < 0.01 * steps.mean()
    np.testing.assert_allclose(np.sort(inner[[0, -1]], axis=0)[1], line[-1], atol=1e-6)


def test_a_cubic_of_u_ends_at_its_length(tmp_path: Path) -> None:
    """v = 0.005 u^2 has a length of 60 m at u = 57.04, where the next geometry starts."""
    shape = '<poly3 a="0" b="0" c="0.005" d="0"/>'
    line = next(x for x in read(tmp_path, "", shape=shape, length=60).lanes if "left1" in x.name)
    inner = line.left[:, :2]  # the reference line
    end = inner[np.argmax(inner[:, 0])]
    np.testing.assert_allclose(end, (57.0423, 0.005 * 57.0423**2), atol=1e-3)
    steps = np.hypot(*np.diff(inner, axis=0).T)
    np.testing.assert_allclose(steps, 1, atol=1e-3)


@pytest.mark.parametrize(("stated", "names"), [(100, 0), (100.5, 0), (2000, 1), (40, 1)])
def test_a_length_that_is_not_that_of_the_geometry_is_named(
    tmp_path: Path, stated: float, names: int
) -> None:
    road = site_data.road(1, (0, 0, 0), 100).replace('length="100"', f'length="{stated}"', 1)
    (tmp_path / "a.xodr").write_text(site_data.open_drive(road))
    notes = read_opendrive(tmp_path / "a.xodr").not_understood
    assert len([n for n in notes if n.startswith("road 1: length: expected 100 m")]) == names


def test_an_open_outline_is_a_thin_wall_along_its_corners(tmp_path: Path) -> None:
    angles = np.linspace(-0.6, 0.6, 13)
    uv = np.column_stack([45 * np.sin(angles), 45 - 45 * np.cos(angles)])
    corners = "".join(f'<cornerLocal u="{u}" v="{v}" z="0" height="0.8"/>' for u, v in uv)
    # first the layout of version 1.5 and later, then that of 1.4
    for frame in ("<outlines>{}</outlines>", "{}"):
        inner = frame.format(f'<outline closed="false">{corners}</outline>')
        rail = f'<object type="barrier" id="1" s="50" t="5" length="54" width="0">{inner}</object>'
        site_map = read(tmp_path, objects(rail), shape=BEND)
        assert len(site_map.bodies) == 12
        np.testing.assert_allclose(radii(site_map.bodies), 45, atol=0.15)
        assert {b.height_m for b in site_map.bodies} == {0.8}


def test_a_closed_outline_supersedes_the_box(tmp_path: Path) -> None:
    local = [(-10, -5), (10, -5), (10, 5), (-10, 5)]
    corners = "".join(f'<cornerLocal u="{u}" v="{v}" z="0" height="6"/>' for u, v in local)
    on_road = "".join(
        f'<cornerRoad s="{40 + u}" t="{-25 + v}" dz="0" height="6"/>' for u, v in local
    )
    for text in (corners, on_road):
        house = '<object type="building" id="1" s="40" t="-25" length="3" width="3" height="6">'
        site_map = read(
            tmp_path, objects(f"{house}<outlines><outline>{text}</outline></outlines></object>")
        )
        low, high = site_map.bodies[0].outline.min(0), site_map.bodies[0].outline.max(0)
        np.testing.assert_allclose([low, high], [(30, -30), (50, -20)], atol=1e-9)
        assert site_map.bodies[0].height_m == 6


def test_a_continuous_repeat_follows_the_bend(tmp_path: Path) -> None:
    span = 's="10" length="60" distance="0" tStart="6" tEnd="6" widthStart="0.3" widthEnd="0.3"'
    repeat = f'<repeat {span} heightStart="1" heightEnd="2"/>'
    rail = f'<object type="railing" id="1" s="0" t="0" height="0">{repeat}</object>'
    site_map = read(tmp_path, objects(rail), shape=BEND)
    np.testing.assert_allclose(radii(site_map.bodies), 44, atol=0.2)
    heights = [b.height_m for b in site_map.bodies]
    assert heights[0] == pytest.approx(1, abs=0.05)
    assert heights[-1] == pytest.approx(2, abs=0.05)
    ends = np.concatenate([b.outline for b in site_map.bodies])
    reach = np.arctan2(ends[:, 0], 50 - ends[:, 1]) * 50
    assert (reach.min(), reach.max()) == pytest.approx((10, 70), abs=0.01)


def test_a_repeat_with_a_distance_is_copies_and_not_the_object(tmp_path: Path) -> None:
    span = 's="20" length="30" distance="10" tStart="8" tEnd="14"'
    repeat = f'<repeat {span} heightStart="4" heightEnd="4"/>'
    pole = f'<object type="pole" id="1" s="0" t="0" radius="0.2" height="9">{repeat}</object>'
    tree = f'<object type="tree" id="2" s="0" t="0" height="9">{repeat}</object>'
    site_map = read(tmp_path, objects(pole + tree))
    wanted = [(20, 8), (30, 10), (40, 12), (50, 14)]
    np.testing.assert_allclose([b.outline.mean(0) for b in site_map.bodies], wanted, atol=1e-9)
    np.testing.assert_allclose([(t.x_m, t.y_m) for t in site_map.trees], wanted, atol=1e-9)
    assert {b.height_m for b in site_map.bodies} == {t.height_m for t in site_map.trees} == {4}


ASAM = (
    "barrier bike building bus car gantry motorbike none obstacle parkingSpace patch pedestrian "
    "pole railing roadSurface soundBarrier streetLamp trafficIsland trailer train tram tree van "
    "vegetation wind somethingElse"
).split()


@pytest.mark.parametrize("kind", ASAM)
def test_each_kind_of_object_is_built_or_listed(tmp_path: Path, kind: str) -> None:
    for extent in ('length="2" width="1" height="3"', 'radius="0.5" height="3"', ""):
        thing = f'<object type="{kind}" id="7" s="40" t="9" {extent}/>'
        site_map = read(tmp_path, objects(thing))
        listed = any("object 7" in note for note in site_map.not_understood)
        assert site_map.bodies or site_map.trees or listed, extent


@pytest.mark.parametrize(
    "more",
    [
        '<objects><tunnel id="7" s="10" length="20"/></objects>',
        '<objects><bridge id="7" s="10" length="20"/></objects>',
        '<objects><objectReference id="7" s="10" t="0"/></objects>',
        '<signals><signalReference id="7" s="10" t="0" orientation="+"/></signals>',
        '<surface><CRG file="a.crg"/></surface>',
        '<railroad><switch id="7"/></railroad>',
    ],
)
def test_what_else_a_road_has_is_listed(tmp_path: Path, more: str) -> None:
    assert len(read(tmp_path, more).not_understood) == 1


UNREAD_OF_A_MAP = {
    "controller": '<controller id="1"><control signalId="1"/></controller><controller id="2"/>',
    "junctionGroup": '<junctionGroup id="1"><junctionReference junction="4"/></junctionGroup>',
    "station": '<station id="1"><platform id="2"/></station>',
    "junction/objects": '<junction id="4"><objects><object id="5"/></objects></junction>',
    "junction/boundary": '<junction id="4"><boundary><segment type="lane"/></boundary></junction>',
    "junction/elevationGrid": '<junction id="4"><elevationGrid gridSpacing="1"/></junction>',
    "junction/controller": '<junction id="4"><controller id="1"/></junction>',
    "userData": '<userData code="a"><userData code="b"/></userData>',
    "somethingElse": "<somethingElse/>",
}
UNREAD_OF_AN_OBJECT = ["markings", "parkingSpace", "borders", "skeleton", "material", "validity"]
UNREAD_OF_A_SIGNAL = ["positionRoad", "positionInertial", "dependency", "reference"]
UNREAD_OF_A_LANE = ["material", "roadMark", "rule"]


@pytest.mark.parametrize("kind", UNREAD_OF_A_MAP)
def test_each_kind_of_element_of_a_map_that_is_not_read_is_listed(
    tmp_path: Path, kind: str
) -> None:
    text = UNREAD_OF_A_MAP[kind]
    file = tmp_path / "a.xodr"
    file.write_text(site_data.open_drive(site_data.road(1, (0, 0, 0), 100), text))
    count = 2 if kind == "controller" else 1
    assert read_opendrive(file).not_understood == [f"{kind}: not read, {count} in the file"]


def test_parts_of_objects_signals_and_lanes_that_are_not_read_are_listed(tmp_path: Path) -> None:
    """Each is listed with the number of its occurrences in the file, also if the file has a
    namespace."""

    def inside(tags: list[str]) -> str:
        return "".join(f"<{tag}><part/></{tag}>" for tag in tags)

    house = '<object type="building" id="{}" s="40" t="20" length="3" width="3" height="6">{}'
    things = "".join(house.format(k, inside(UNREAD_OF_AN_OBJECT)) + "</object>" for k in range(3))
    sign = f'<signal id="1" s="20" t="5" height="2">{inside(UNREAD_OF_A_SIGNAL)}</signal>'
    lanes = site_data.LANES.replace(
        '<lane id="-1" type="driving">', f'<lane id="-1" type="driving">{inside(UNREAD_OF_A_LANE)}'
    )
    more = f"{objects(things)}<signals>{sign}</signals>"
    text = site_data.open_drive(site_data.road(1, (0, 0, 0), 100, lanes=lanes, more=more))
    wanted = [f"object/{tag}: not read, 3 in the file" for tag in UNREAD_OF_AN_OBJECT]
    wanted += [f"signal/{tag}: not read, 1 in the file" for tag in UNREAD_OF_A_SIGNAL]
    wanted += [f"lane/{tag}: not read, 1 in the file" for tag in UNREAD_OF_A_LANE]
    file = tmp_path / "a.xodr"
    for whole in (text, text.replace("<OpenDRIVE>", '<OpenDRIVE xmlns="http://code.asam.net">')):
        file.write_text(whole)
        assert sorted(read_opendrive(file).not_understood) == sorted(wanted)


def test_what_hangs_over_the_road_leaves_it_free(tmp_path: Path) -> None:
    sign = (
        '<object type="gantry" id="1" s="50" t="0" zOffset="5" length="1" width="20" height="2"/>'
    )
    body = read(tmp_path, objects(sign)).bodies[0]
    assert (body.hangs, body.base_m, body.height_m) == (True, 5, 2)


def test_the_network_does_without_what_it_cannot_read(tmp_path: Path) -> None:
    """The map has an arc without a curvature, signals without a type, and a junction of an unknown
    kind."""
    signals = (
        '<signals><signal id="1" type="" s="20" t="5" zOffset="2" height="0.6"/>'
        '<signal id="2" s="20" t="-5" zOffset="2" height="0.6"/></signals>'
    )
    rise = '<elevation s="0" a="0" b="0.1" c="0" d="0"/>'
    road = site_data.road(
        1, (0, 0, 0), 200, shape='<arc curvature="0.0"/>', more=signals, elevation=rise
    )
    virtual = '<junction id="4" type="crossing"><crossPath id="1"/></junction>'
    made = imported(tmp_path, site_data.open_drive(road, virtual))
    listed = made["not_understood"]
    assert [n for n in listed if "type is empty" in n] == [
        f"road 1: signal {k}: type is empty; left out of the network" for k in (1, 2)
    ]
    assert any("junction 4: type 'crossing'" in n for n in listed)


def test_a_direct_junction_leads_to_both_of_its_roads(tmp_path: Path) -> None:
    pytest.importorskip("sumo", reason="needs the extra `site`")
    from pyinfra.scenes.maps.road_net import read_road_net

    def link(end: str) -> str:
        return f'<link><{end} elementType="junction" elementId="9"/></link>'

    lane = '<lane id="-{}" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'

    def lanes(count: int) -> str:
        inner = "".join(lane.format(k + 1) for k in range(count))
        return (
            '<lanes><laneSection s="0"><center><lane id="0" type="none"/></center>'
            f"<right>{inner}</right></laneSection></lanes>"
        )

    roads = [
        site_data.road(1, (0, 0, 0), 200, lanes=lanes(2), more=link("successor")),
        site_data.road(2, (200, 0, 0), 200, lanes=lanes(1), more=link("predecessor")),
        site_data.road(
            3, (200, -3.5, 0), 200, lanes=lanes(1), more=link("predecessor"),
            shape='<arc curvature="-0.002"/>',
        ),
    ]  # fmt: skip
    junction = '<junction id="9" type="direct">'
    for number, (to, from_lane) in enumerate(((2, -1), (3, -2))):
        junction += (
            f'<connection id="{number}" incomingRoad="1" linkedRoad="{to}" contactPoint="start">'
            f'<laneLink from="{from_lane}" to="-1"/></connection>'
        )
    made = imported(tmp_path, site_data.open_drive(*roads, junction + "</junction>"))
    assert any("junction 9: type 'direct'" in n for n in made["not_understood"])
    net = read_road_net(tmp_path / "site/map.net.xml")
    first = max(net.links, key=lambda name: len(net.links[name]))
    assert len(net.links[first]) == 2


def test_a_steep_road_is_named_and_a_cliff_refused(tmp_path: Path) -> None:
    rise = '<elevation s="0" a="0" b="0.7" c="0" d="0"/>'
    made = imported(
        tmp_path, site_data.open_drive(site_data.road(1, (0, 0, 0), 50, elevation=rise))
    )
    assert any("a grade of 70%" in n for n in made["not_understood"])


def test_a_banked_road_lies_as_its_roll_says(tmp_path: Path) -> None:
    bank = '<lateralProfile><superelevation s="0" a="0.3" b="0" c="0" d="0"/></lateralProfile>'
    file = tmp_path / "a.xodr"
    file.write_text(site_data.open_drive(site_data.road(1, (0, 0, 0), 100, more=bank)))
    lane = next(lane for lane in read_opendrive(file).lanes if lane.name == "road1_0_left1")
    rise, across = lane.left[0] - lane.right[0], 3.5
    assert abs(rise[2]) == pytest.approx(across * math.sin(0.3))


@pytest.mark.parametrize("tag", ["signal", "signalReference"])
@pytest.mark.parametrize("key", ["id", "type", "orientation", "dynamic", "s", "t", "validity"])
def test_signals_that_the_network_cannot_read_are_left_out_of_it(
    tmp_path: Path, tag: str, key: str
) -> None:
    """The map is imported even if attributes of a signal are missing or wrong."""
    whole = {"id": "4", "type": "1", "orientation": "+", "dynamic": "yes", "s": "50", "t": "5"}

    def signal(name: str, words: dict[str, str], inner: str = "") -> str:
        pairs = " ".join(f'{k}="{v}"' for k, v in words.items())
        return f"<{name} {pairs}>{inner}</{name}>"

    texts = [
        signal(tag, {k: v for k, v in whole.items() if k != key}),
        signal(tag, {**whole, key: ""}),
    ]
    if key == "validity":
        texts = [signal(tag, whole, '<validity fromLane="-1"/>')]
    if tag == "signalReference":
        texts += [signal(tag, {**whole, "id": "99"})]
        texts = [signal("signal", whole) + text for text in texts]
    for i, text in enumerate(texts):
        folder = tmp_path / str(i)
        folder.mkdir()
        road = site_data.road(1, (0, 0, 0), 100, more=f"<signals>{text}</signals>")
        if (tag, key, i) in {("signal", "s", 1), ("signal", "t", 1)}:  # the signal has no position
            with pytest.raises(MapError, match=f"<signal .*{key}: expected .*got ''"):
                imported(folder, site_data.open_drive(road))
            continue
        imported(folder, site_data.open_drive(road))
