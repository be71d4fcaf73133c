"""Maps and tracks as they are published: roofs, passages, left-hand rule, UTM, no heights."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from site_maps import junction

from pyinfra.core.errors import Error
from pyinfra.scenes.maps import fcd
from pyinfra.scenes.maps.lane_comparison import AGAINST, bodies_on_lanes, lane_differences
from pyinfra.scenes.maps.lane_heights import on_lanes
from pyinfra.scenes.maps.lane_map import MapBody, MapLane
from pyinfra.scenes.maps.left_hand import mirrored_map
from pyinfra.scenes.maps.map_import import import_map
from pyinfra.scenes.maps.map_readers import ImportOptions
from pyinfra.scenes.maps.netconvert import netconvert
from pyinfra.scenes.maps.network import read_network
from pyinfra.scenes.maps.opendrive import read_opendrive
from pyinfra.scenes.maps.osm_buildings import Passage, building_bodies, is_underground
from pyinfra.scenes.maps.recorded_boxes import BoxColumns, read_boxes
from pyinfra.scenes.maps.site_traffic import write_traffic
from pyinfra.scenes.maps.sumo import SumoError
from pyinfra.scenes.maps.surfaces import contains
from pyinfra.scenes.maps.traffic_demand import Demand
from pyinfra.scenes.maps.trajectory_import import import_boxes, import_fcd

HOUSE = np.array([[12.0, -20], [36, -20], [36, 20], [12, 20]])
ROAD = Passage("7", np.array([[12.0, 0], [36, 0]]), 4.5, 4.2)
LANE = '<lane id="{}" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'


def xodr(file: Path, x: float = 0, y: float = 0, rule: str = "") -> Path:
    """Writes a straight road of 300 m with one lane each way."""
    file.write_text(
        '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="7"/>'
        f'<road id="1" length="300" junction="-1" {rule}><link/><planView>'
        f'<geometry s="0" x="{x}" y="{y}" hdg="0" length="300"><line/></geometry></planView>'
        f'<lanes><laneSection s="0"><left>{LANE.format(1)}</left><center>'
        f'<lane id="0" type="none"/></center><right>{LANE.format(-1)}</right></laneSection></lanes>'
        "</road></OpenDRIVE>"
    )
    return file


def lane(name: str, y: float, *, east: bool = True) -> MapLane:
    x = np.array([-100.0, 100]) if east else np.array([100.0, -100])
    side = 1.75 if east else -1.75
    left, right = (np.column_stack([x, [y + s] * 2, [0.0] * 2]) for s in (side, -side))
    return MapLane(name, "road", True, left, right)


def test_a_passage_is_free_and_keeps_the_storeys_above() -> None:
    bodies, notes = building_bodies("5", HOUSE, 18.0, 0.0, {}, [ROAD])
    upper, *lower = bodies
    assert (upper.hangs, upper.above_m, upper.height_m) == (True, 4.2, pytest.approx(13.8))
    on_road = np.array([[20.0, 0], [30, 1.6]])
    assert contains(upper.outline, on_road).all()
    assert len(lower) == 2
    assert not any(contains(part.outline, on_road).any() for part in lower)
    assert "passage of way 7" in notes[0]


def test_a_roof_and_a_house_on_pillars_are_open_below() -> None:
    (roof,), notes = building_bodies("5", HOUSE, 6.0, 0.0, {"building": "roof"}, [])
    assert (roof.hangs, roof.above_m) == (True, 5.5)
    assert "roof" in notes[0]
    (raised,), _ = building_bodies("5", HOUSE, 18.0, 4.0, {"building": "yes"}, [])
    assert (raised.hangs, raised.above_m, raised.height_m) == (True, 4.0, 14.0)


@pytest.mark.parametrize("tags", [{"location": "underground"}, {"layer": "-1"}, {"level": "-2"}])
def test_buildings_below_the_ground(tags: dict[str, str]) -> None:
    assert is_underground(tags)
    assert not is_underground({"layer": "1"})


def test_a_house_on_a_lane_is_named() -> None:
    (note,) = bodies_on_lanes([MapBody(HOUSE, 9.0, name="way 5: building")], [lane("a", 0)])
    assert note.startswith("way 5: building: stands on a lane, a, at 12")
    assert bodies_on_lanes([MapBody(HOUSE, 9.0, None, True, 4.0)], [lane("a", 0)]) == []
    assert bodies_on_lanes([MapBody(HOUSE, 9.0)], [lane("a", 30)]) == []


def test_lanes_that_differ_from_the_network_are_named() -> None:
    network = [lane("n", -1.75)]
    assert lane_differences([lane("a", -1.75)], network) == []
    (note,) = lane_differences([lane("a", -1.75, east=False)], network)
    assert AGAINST in note
    (note,) = lane_differences([lane("a", 9.0)], network)
    assert "not in the network" in note


def test_vehicles_drive_on_the_left_where_the_map_says_so(tmp_path: Path) -> None:
    map_ = xodr(tmp_path / "a.xodr", 100, 5000, rule='rule="LHT"')
    imported = import_map(map_, tmp_path / "site", ImportOptions(radius_m=300))
    assert imported["not_understood"] == []
    write_traffic(tmp_path / "site", Demand(900), 30, 1)
    driven = pd.read_csv(tmp_path / "site/trajectories.csv").query("speed > 1")
    to_east = np.cos(driven.heading) > 0
    assert 0 < to_east.sum() < len(driven)
    assert np.array_equal(driven.y > 0, to_east)


def test_a_left_hand_junction_is_the_mirrored_right_hand_junction(tmp_path: Path) -> None:
    """Networks and traffic are the same, mirrored at the x axis."""
    right = tmp_path / "right.xodr"
    right.write_text(junction([0.0, 100.0, 200.0], 15.0))
    left = mirrored_map(right, tmp_path / "left.xodr")
    left.write_text(left.read_text().replace('rule="RHT"', 'rule="LHT"'))
    lanes, tracks = [], []
    for side, file in ((1, right), (-1, left)):
        site = tmp_path / file.stem
        mount = (0.0, 30.0 * side, 6.0, -90.0 * side)
        options = ImportOptions(centre=(0.0, 0.0), radius_m=400, mount=mount)
        imported = import_map(file, site, options)
        assert [n for n in imported["not_understood"] if "network" in n] == []
        network = read_network(site / "map.net.xml").lanes
        lanes.append({x.name: x.centre * (1, side, 1) for x in network})
        write_traffic(site, Demand(900), 20, 1)
        table = pd.read_csv(site / "trajectories.csv")
        tracks.append(table.assign(y=table.y * side, heading=table.heading * side))
    assert lanes[0].keys() == lanes[1].keys()
    for name, centre in lanes[0].items():
        np.testing.assert_allclose(lanes[1][name], centre, atol=0.02)
    assert len(tracks[0]) > 100
    one, two = (table[["t", "id", "x", "y"]] for table in tracks)
    np.testing.assert_allclose(two, one, atol=0.1)  # networks have centimetres


def test_roads_of_both_rules_are_refused_by_name(tmp_path: Path) -> None:
    roads = [
        xodr(tmp_path / f"{k}.xodr", 0, 100 * k, 'rule="LHT"' if k else "").read_text()
        for k in range(3)
    ]
    parts = [text.partition("<road")[2].partition("</OpenDRIVE>")[0] for text in roads]
    body = "".join("<road" + p.replace('id="1"', f'id="{k}"', 1) for k, p in enumerate(parts))
    (tmp_path / "a.xodr").write_text(f"{roads[0].partition('<road')[0]}{body}</OpenDRIVE>")
    imported = import_map(tmp_path / "a.xodr", tmp_path / "site", ImportOptions(radius_m=300))
    assert sum(AGAINST in note for note in imported["not_understood"]) == 4
    with pytest.raises(Error, match="left-hand"):
        write_traffic(tmp_path / "site", Demand(900), 30, 1)


@pytest.mark.parametrize("breaks", ["--crossings.guess", "--junctions.join", ""])
def test_a_crash_of_netconvert_is_tried_again_without_an_option(
    breaks: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With no option to blame, the message names what a user can do."""
    runs = []

    def run(name: str, words: list[str], *, longest_s: float) -> list[str]:
        runs.append(words)
        if breaks in words or not breaks:
            error = SumoError("netconvert: no reason (exit -11)")
            error.crashed = True
            raise error
        (tmp_path / "net.xml").write_text("<net></net>")
        return []

    monkeypatch.setattr("pyinfra.scenes.maps.netconvert.run_tool", run)
    words = ["--junctions.join", "--crossings.guess", "--proj", "x"]
    if breaks:
        (warning,) = netconvert(tmp_path / "a.osm", words, tmp_path / "net.xml")
        assert warning == f"netconvert crashed with {breaks} and ran without it"
    else:
        with pytest.raises(Error, match=r"exit -11\); use a smaller map"):
            netconvert(tmp_path / "a.osm", words, tmp_path / "net.xml")
        assert len(runs) == 3


def test_an_error_of_netconvert_is_not_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = []

    def run(name: str, words: list[str], *, longest_s: float) -> list[str]:
        runs.append(words)
        raise SumoError("netconvert: no roads (exit 1)")

    monkeypatch.setattr("pyinfra.scenes.maps.netconvert.run_tool", run)
    with pytest.raises(Error, match=r"no roads \(exit 1\)$"):
        netconvert(tmp_path / "a.osm", ["--junctions.join"], tmp_path / "net.xml")
    assert len(runs) == 1


def test_a_lanelet2_map_without_borders_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.osm"
    file.write_text(
        '<osm version="0.6"><node id="1" lat="49" lon="8"/><way id="2"><nd ref="1"/></way>'
        '<relation id="3"><tag k="type" v="lanelet"/></relation></osm>'
    )
    with pytest.raises(Error, match="expected one or more lanelets with two borders"):
        import_map(file, tmp_path / "site")


def test_a_map_in_utm_coordinates(tmp_path: Path) -> None:
    map_ = xodr(tmp_path / "a.xodr", 691_000, 5_334_000)
    imported = import_map(map_, tmp_path / "site", ImportOptions(radius_m=300))
    assert imported["lanes"] == 2
    assert imported["offset_m"][:2] == [691_150, 5_334_000]
    assert not any(AGAINST in note for note in imported["not_understood"])


def test_tracks_of_drones_have_no_heights(tmp_path: Path) -> None:
    (tmp_path / "07_tracks.csv").write_text(
        "recordingId,trackId,frame,xCenter,yCenter,heading,width,length\n"
        + "".join(f"7,0,{k},{20 + 0.4 * k},-30.0,0.0,1.8,4.5\n" for k in range(101))
    )
    (tmp_path / "07_tracksMeta.csv").write_text("recordingId,trackId,class\n7,0,car\n")
    how = BoxColumns({}, {"car": "Car"}, 25.0, True)
    boxes = read_boxes(tmp_path / "07_tracks.csv", how)
    standing, notes = on_lanes(tmp_path, boxes, np.zeros(3))
    assert standing[0].boxes[:, 2] == pytest.approx(standing[0].boxes[:, 5] / 2)
    assert "no column z" in notes[0]
    (track,) = import_boxes(standing, np.zeros(3)).tracks
    assert track.states[-1, 0] - track.states[0, 0] == pytest.approx(40, abs=0.5)


def test_tracks_of_drones_have_no_sizes_of_people(tmp_path: Path) -> None:
    """In inD and its relatives, width and length of pedestrians and bicycles are 0."""
    objects = ((0, 0.4, "1.8,4.5"), (1, 0.05, "0.0,0.0"), (2, 0.2, "0,0"))
    rows = [
        f"7,{i},{k},{20 + step * k},{9.0 * i},0.0,{size}\n"
        for i, step, size in objects
        for k in range(101)
    ]
    (tmp_path / "07_tracks.csv").write_text(
        "recordingId,trackId,frame,xCenter,yCenter,heading,width,length\n" + "".join(rows)
    )
    (tmp_path / "07_tracksMeta.csv").write_text(
        "recordingId,trackId,class\n7,0,car\n7,1,pedestrian\n7,2,bicycle\n"
    )
    of_class = {"car": "Car", "pedestrian": "Pedestrian", "bicycle": "Cyclist"}
    how = BoxColumns({}, of_class, 25.0, True)
    boxes = read_boxes(tmp_path / "07_tracks.csv", how)
    imported = import_boxes(on_lanes(tmp_path, boxes, np.zeros(3))[0], np.zeros(3))
    sizes = {track.object_class: track.size_m[:2].tolist() for track in imported.tracks}
    assert sizes == {"Car": [4.5, 1.8], "Pedestrian": [0.73, 0.67], "Cyclist": [1.67, 0.7]}
    assert any(note.startswith("sizes of 0 of 2 objects") for note in imported.notes)


def test_sumo_writes_tables_with_semicolons(tmp_path: Path) -> None:
    file = tmp_path / "fcd.csv"
    file.write_text(
        "timestep_time;vehicle_angle;vehicle_id;vehicle_type;vehicle_x;vehicle_y;person_id\n"
        + "".join(f"{k};90.00;a;passenger;{10 * k};-1.6;\n" for k in range(5))
    )
    assert fcd.is_fcd_csv(file)
    (track,) = import_fcd(fcd.read_fcd(file), {}, np.zeros(3)).tracks
    assert track.states[-1, 0] - track.states[0, 0] == pytest.approx(40, abs=0.5)


def test_a_section_of_one_side_does_not_end_the_lanes_of_the_other(tmp_path: Path) -> None:
    text = xodr(tmp_path / "a.xodr").read_text()
    right = f"<right>{LANE.format(-1)}{LANE.format(-2)}</right>"
    section = f'<laneSection s="100" singleSide="true">{right}</laneSection></lanes>'
    file = tmp_path / "b.xodr"
    file.write_text(text.replace("</lanes>", section))
    lanes = {lane.name: lane for lane in read_opendrive(file).lanes}
    lengths = {
        name: round(float(np.hypot(*np.diff(lane.left[:, :2], axis=0).T).sum()))
        for name, lane in lanes.items()
    }
    assert sorted(lengths.values()) == [100, 200, 200, 300]
    assert lengths[next(name for name in lanes if "left1" in name)] == 300
    borders = [float(lane.left[0, 1] - lane.right[0, 1]) for lane in lanes.values()]
    np.testing.assert_allclose(np.abs(borders), 3.5)


@pytest.mark.parametrize("rule", ["", 'rule="LHT"'])
def test_a_reversed_lane_runs_the_other_way(tmp_path: Path, rule: str) -> None:
    """The attribute is of OpenDRIVE 1.8. SUMO does not know it, which the comparison names."""
    pytest.importorskip("sumo", reason="needs the extra `site`")
    file = xodr(tmp_path / "a.xodr", rule=rule)
    usual = {x.name: x for x in read_opendrive(file).lanes}
    text = file.read_text().replace('<lane id="1" ', '<lane id="1" direction="reversed" ')
    file.write_text(text.replace('<lane id="-1" ', '<lane id="-1" direction="standard" '))
    lanes = {x.name: x for x in read_opendrive(file).lanes}
    name, other = "road1_0_left1", "road1_0_right1"
    np.testing.assert_array_equal(lanes[name].left, usual[name].right[::-1])
    np.testing.assert_array_equal(lanes[name].right, usual[name].left[::-1])
    np.testing.assert_array_equal(lanes[other].left, usual[other].left)
    notes = import_map(file, tmp_path / "site")["not_understood"]
    assert [note.startswith(f"lane {name}: runs {AGAINST}") for note in notes] == [True]


def test_a_lane_ends_where_its_direction_changes(tmp_path: Path) -> None:
    linked = LANE.replace("<width", '<link><successor id="1"/></link><width')
    section = f'<left>{linked.format(1)}</left><center><lane id="0" type="none"/></center>'
    text = xodr(tmp_path / "a.xodr").read_text()
    first = text[text.index('<laneSection s="0">') : text.index("</lanes>")]
    reversed_ = section.replace("<lane id", '<lane direction="reversed" id', 1)
    sections = f'<laneSection s="0">{section}</laneSection>'
    sections += f'<laneSection s="150">{reversed_}</laneSection>'
    (tmp_path / "b.xodr").write_text(text.replace(first, sections))
    assert [x.name for x in read_opendrive(tmp_path / "b.xodr").lanes] == [
        "road1_0_left1",
        "road1_1_left1",
    ]


BANK = '<lateralProfile><superelevation s="0" a="{}" b="0" c="0" d="0"/></lateralProfile><lanes>'


@pytest.mark.parametrize(
    ("words", "has_bank", "note"),
    [
        ('direction="both"', False, 'lane: direction="both": not read, 2 in the file'),
        (
            'dynamicLaneDirection="true"',
            False,
            "lane: dynamicLaneDirection: not read, 2 in the file",
        ),
        ('level="true"', True, "lane: level: not read, 2 in the file"),
        ('level="true"', False, ""),  # without superelevation, all lanes are level
        ('level="false" dynamicLaneDirection="false"', True, ""),
    ],
)
def test_attributes_of_lanes_that_are_not_read_are_listed(
    tmp_path: Path, words: str, has_bank: bool, note: str
) -> None:
    file = xodr(tmp_path / "a.xodr")
    text = file.read_text().replace('type="driving"', f'type="driving" {words}')
    file.write_text(text.replace("<lanes>", BANK.format(0.08)) if has_bank else text)
    assert read_opendrive(file).not_understood == [note] * bool(note)


@pytest.mark.parametrize(("width_m", "expected_m"), [("", 2.0), (3.5, 3.5)])
def test_a_border_counts_only_without_widths(
    tmp_path: Path, width_m: float | str, expected_m: float
) -> None:
    border = '<border sOffset="0" a="-2" b="0" c="0" d="0"/>'
    width = f'<width sOffset="0" a="{width_m}" b="0" c="0" d="0"/>' if width_m else ""
    lane = f'<lane id="-1" type="driving">{border}{width}</lane>'
    file = xodr(tmp_path / "a.xodr")
    file.write_text(file.read_text().replace(LANE.format(-1), lane))
    right = next(x for x in read_opendrive(file).lanes if x.name == "road1_0_right1")
    np.testing.assert_allclose(right.width, expected_m)
