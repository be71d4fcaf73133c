"""Networks that distinguish vehicles, pedestrians and cyclists, and the labels that they learn
from."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from detector_data import FLOOR_Z, SITE, road_sample, vehicle_points
from test_detectors import crossing

torch = pytest.importorskip("torch")

from pyinfra.core.errors import ConfigError  # noqa: E402
from pyinfra.core.vocabulary import OBJECT_CLASSES, ObjectClass  # noqa: E402
from pyinfra.dataset.frame_tables import Vehicles  # noqa: E402
from pyinfra.models.detectors import Detections, calibration  # noqa: E402
from pyinfra.models.detectors.batch import Windows, make_batch  # noqa: E402
from pyinfra.models.detectors.bev_config import BevConfig  # noqa: E402
from pyinfra.models.detectors.catalogue import config_of  # noqa: E402
from pyinfra.models.detectors.centerpoint_pillar import CenterPointPillar, Config  # noqa: E402
from pyinfra.models.detectors.centre_head import AxisHead  # noqa: E402
from pyinfra.models.detectors.classes import TYPES, numbers_of  # noqa: E402
from pyinfra.models.detectors.sample import Sample  # noqa: E402
from pyinfra.models.detectors.windows import view_of  # noqa: E402
from pyinfra.models.training import checkpoint, train, validation  # noqa: E402
from pyinfra.models.training.provenance import Provenance  # noqa: E402
from pyinfra.models.training.recipe import Learning, Recipe  # noqa: E402
from pyinfra.models.training.samples import Augmentation, Frames, augmented  # noqa: E402
from pyinfra.models.training.sources import Source, hit_boxes  # noqa: E402

ALL: tuple[ObjectClass, ...] = ("vehicle", "pedestrian", "cyclist")
SMALL = BevConfig(layers=(1, 1), widths=(8, 8), strides=(2, 2), up_width=8)
PERSON_M = (0.73, 0.67, 1.77)


def config(classes: tuple[ObjectClass, ...] = ALL) -> Config:
    return Config(
        pillar_m=0.4, pillar_width=8, bev=SMALL, head_width=8, axis=True, place=False,
        classes=classes,
    )  # fmt: skip


def mixed_sample(seed: int) -> Sample:
    """Returns a frame with vehicles in lanes and two people between them."""
    road, draw = road_sample(seed, vehicles=2), np.random.default_rng(seed)
    people = np.array([[x, y, FLOOR_Z + PERSON_M[2] / 2, *PERSON_M, 0.3] for x, y in
                       ((12.0, 11.9), (22.0, -12.2))])  # fmt: skip
    clouds = [road.points, *(vehicle_points(box, draw, 60) for box in people)]
    boxes = np.concatenate([road.boxes, people])
    return Sample(np.concatenate(clouds), boxes, np.array([0, 0, 1, 2]))


def test_each_class_has_heat_at_its_own_boxes_alone() -> None:
    head = AxisHead(4, 4, SITE, 0.8, ALL)
    batch = make_batch([mixed_sample(1)], SITE.area)
    boxes, numbers = batch.boxes[0], batch.classes[0]
    assert numbers.tolist() == [0, 0, 1, 2]
    sure = torch.full((1, 3, 32, 48), -12.0)
    row, column = head.cells_of(boxes, (32, 48))
    sure[0, numbers, row, column] = 12.0
    residuals = torch.zeros(1, 32, 48, 9)
    residuals[0, row, column, :8] = head.encode(boxes, row, column)
    head.forward = lambda x: (sure, residuals)  # type: ignore[method-assign]
    right = head.losses(torch.zeros(1), batch.boxes, batch.classes)
    wrong = head.losses(torch.zeros(1), batch.boxes, (2 - batch.classes[0],))
    for name in ALL:
        assert right[f"heat_{name}"] < 0.2
        # the pedestrian is in the middle, so its heat is right
        assert wrong[f"heat_{name}"] > 3 or name == "pedestrian"
    ((peaks, scores, classes),) = head.candidates(torch.zeros(1, 1))
    best = scores > 0.5
    assert sorted(classes[best].tolist()) == [0, 0, 1, 2]
    for box, number in zip(boxes, numbers, strict=True):
        of_class = peaks[best & (classes == number)]
        assert (of_class[:, :2] - box[:2]).norm(dim=1).min() < 1e-3


def test_a_road_s_axis_is_no_pedestrian_s() -> None:
    head = AxisHead(4, 4, SITE, 0.8, ALL)
    head.know(crossing(), (32, 48))
    box = torch.tensor([[20.0, 0.5, -4.5, 0.7, 0.6, 1.8, math.pi / 3]])
    row, column = head.cells_of(box, (32, 48))
    residuals = torch.cat([head.encode(box, row, column), torch.zeros(1, 1)], dim=1)
    residuals[:, 6:8] *= 1e-3
    along = head.decode(residuals, row, column, along_road=True)[0, 6]
    alone = head.decode(residuals, row, column, along_road=False)[0, 6]
    assert along == pytest.approx(0, abs=1e-2)
    assert alone == pytest.approx(math.pi / 3, abs=1e-4)
    # the roads of another site have no effect
    head.know(dataclasses.replace(crossing(), axes=None), (32, 48))
    assert head.decode(residuals, row, column, along_road=True)[0, 6] == alone


def test_boxes_of_a_class_suppress_each_other_alone() -> None:
    torch.manual_seed(0)
    network = CenterPointPillar(config(), SITE).eval()
    boxes = torch.tensor([[10.0, 0, -5, 4, 2, 1.5, 0], [10.5, 0, -5, 4, 2, 1.5, 0]])
    one = (boxes.repeat(2, 1), torch.tensor([0.6, 0.5, 0.9, 0.7]), torch.tensor([0, 0, 1, 1]))
    network.candidates = lambda _: [one]  # type: ignore[method-assign]
    detections = network.predict(road_sample(1).points)
    assert detections.names.tolist() == ["Pedestrian", "vehicle"]
    assert detections.scores == pytest.approx([0.9, 0.6])
    network.calibration = (1.0, 0.0, 1.0, -3.0, 1.0, 0.0)
    detections = network.predict(road_sample(1).points)
    assert detections.names.tolist() == ["vehicle", "Pedestrian"]
    lower = calibration.calibrated(np.array([0.9]), (1.0, -3.0)).item()
    assert detections.scores == pytest.approx([0.6, lower])


def test_types_of_files_have_the_numbers_of_their_classes() -> None:
    types = np.array(["Car", "Pedestrian", "Tram", "Cyclist", "vehicle"])
    assert numbers_of(types, ALL).tolist() == [0, 1, -1, 2, 0]
    assert numbers_of(types, ("cyclist", "vehicle")).tolist() == [1, -1, -1, 0, 1]
    assert all(TYPES[name] in OBJECT_CLASSES[name] for name in ALL)


def test_boxes_of_frames_come_with_the_numbers_of_their_classes() -> None:
    names = np.array(["Car", "Pedestrian", "Cyclist", "Cyclist", "Bus"])
    many, boxes = np.arange(5), np.arange(35.0).reshape(5, 7)
    points = np.array([3, 1, 0, 5, 2])
    vehicles = Vehicles(
        np.array([0, 0, 0, 1, 1]), many, names, boxes, boxes, points, 1.0 * many, 1.0 * many
    )
    hit, numbers = hit_boxes(vehicles, 2, ALL)
    assert [part.tolist() for part in numbers] == [[0, 1], [2, 0]]
    np.testing.assert_array_equal(hit[1], boxes[3:])
    assert [len(part) for part in hit_boxes(vehicles, 2)[0]] == [1, 1]


def test_boxes_keep_their_classes_whatever_is_done_to_a_frame() -> None:
    sample, other = mixed_sample(1), mixed_sample(2)
    how = Augmentation(flip=True, rotation_deg=20, scale=0.05, pasted=4, drop_out=0.9)
    for seed in range(6):
        changed = augmented(sample, other, how, np.random.default_rng(seed))
        assert len(changed.numbers) == len(changed.boxes)
        assert ((changed.boxes[:, 3] < 1) == (changed.numbers > 0)).all()
    batch = make_batch([sample, other], SITE.area)
    seen = Windows(100.0, ((12.0, 10.0), (22.0, -10.0)))
    view = view_of(dataclasses.replace(batch, windows=seen), SITE.area, 0.4, 4)
    assert [part.tolist() for part in view.classes] == [[1], [2]]
    assert [len(part) for part in view.boxes] == [1, 1]


def test_the_best_state_is_that_of_all_classes() -> None:
    network = CenterPointPillar(config(), SITE)
    sample = mixed_sample(3)
    names = np.array([TYPES[ALL[i]] for i in sample.numbers])
    frames = Frames((lambda: sample.points,), (sample.boxes,), classes=(sample.numbers,))
    seen = Detections(sample.boxes, np.linspace(0.9, 0.5, 4), names)
    network.predict = lambda points: seen  # type: ignore[method-assign]
    assert validation.average_precision(network, frames) == pytest.approx(100)
    none = dataclasses.replace(seen, names=np.full(4, "vehicle"))
    network.predict = lambda points: none  # type: ignore[method-assign]
    assert validation.average_precision(network, frames) == pytest.approx(100 / 3)


def recipe(classes: tuple[ObjectClass, ...], start: str = "") -> Recipe:
    learning = Learning(steps=2, batch=2, start=start)
    return Recipe("centerpoint-pillar", config(classes), learning, Augmentation())


def source(classes: tuple[ObjectClass, ...]) -> Source:
    samples = [mixed_sample(seed) for seed in range(4)]
    masks = [s.numbers < len(classes) for s in samples]
    return Source(
        *("lidar", "datasheet", "scene", "scan"),
        clouds=tuple((lambda s=s: s.points) for s in samples),
        read_boxes=lambda: tuple(s.boxes[o] for s, o in zip(samples, masks, strict=True)),
        classes=classes,
        read_classes=lambda: tuple(s.numbers[o] for s, o in zip(samples, masks, strict=True)),
    )


def test_a_network_begins_with_what_one_of_fewer_classes_learnt(tmp_path: Path) -> None:
    vehicles = recipe(("vehicle",))
    one = train.train(vehicles, [source(("vehicle",))], tmp_path / "one", quiet=True)
    begun = train.train(recipe(ALL, str(one)), [source(ALL)], tmp_path / "all", quiet=True)
    assert checkpoint.load(begun).classes == ALL
    network = checkpoint.build("centerpoint-pillar", config(), SITE)
    drawn = network.state_dict()["head.heat.weight"].clone()
    provenance = train._begun_with(network, one, checkpoint.load(begun).provenance)
    assert (provenance.start, provenance.calibration) == (checkpoint.digest(one), None)
    weights, kept = network.state_dict(), checkpoint.load(one).weights()
    torch.testing.assert_close(weights["head.heat.weight"][:1], kept["head.heat.weight"])
    torch.testing.assert_close(weights["head.heat.weight"][1:], drawn[1:])
    torch.testing.assert_close(weights["bev.blocks.0.0.0.weight"], kept["bev.blocks.0.0.0.weight"])


def test_classes_of_network_and_boxes_are_the_same(tmp_path: Path) -> None:
    with pytest.raises(
        ValueError, match=r"network.classes: expected .*got vehicle, pedestrian, cyc"
    ):
        train.train(recipe(ALL), [source(("vehicle",))], tmp_path / "run", quiet=True)


def test_classes_are_known_and_each_is_there_once() -> None:
    plain = {"classes": ["vehicle", "tram"]}
    with pytest.raises(
        ConfigError, match=r"classes.1: expected one of vehicle, pedestrian, .*; got 'tram'"
    ):
        config_of("centerpoint-pillar", plain)
    with pytest.raises(ConfigError, match="twice"):
        config_of("centerpoint-pillar", {"classes": ["cyclist", "cyclist"]})
    with pytest.raises(ConfigError, match="classes: expected at least 1 class, got none"):
        config_of("centerpoint-pillar", {"classes": []})
    assert config_of("centerpoint-pillar", {}).classes == ("vehicle",)
    provenance = Provenance("pointpillars", {}, SITE, "lidar", "datasheet", "scene", 1, 0, 1)
    assert checkpoint.Checkpoint(provenance, {}).classes == ("vehicle",)
