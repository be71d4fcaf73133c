"""Names used by several packages: presets, tiers, object classes, subsets; km/h per m/s."""

from typing import Literal, get_args

KM_H = 3.6  # factor from m/s to km/h

# Presets, that is, settings of a catalogue LiDAR. `datasheet` is closest to the real product.
Preset = Literal["paper", "equal", "datasheet"]
PRESETS: tuple[Preset, ...] = get_args(Preset)

# Tiers, that is, sizes of trainings and benchmarks.
Tier = Literal["smoke", "quick", "full"]
TIERS: tuple[Tier, ...] = get_args(Tier)

# The instant at which a box holds. `frame` is the middle of the frame. `scan` is the mean time of
# the object's returns.
LabelTime = Literal["frame", "scan"]

# Ground-truth subsets: which vehicles inside the evaluation region are evaluated.
# captured: vehicles that have a minimum number of points from this LiDAR.
# common: visible vehicles inside the field of view and range of every LiDAR of the data set.
# all: visible vehicles.
# present: all vehicles, visible or not. This subset is the same for all LiDARs and mounts that have
# the same region.
Subset = Literal["captured", "common", "all", "present"]
SUBSETS: tuple[Subset, ...] = get_args(Subset)

OBJECT_NAMES = {  # maps a class_id of the simulator to a type, named as in KITTI label files
    10: "Car",
    11: "Van",
    12: "Truck",
    13: "Bus",
    14: "Motorcycle",
    15: "Pedestrian",
    16: "Cyclist",
}
# Types of vehicles in label files; "vehicle" is a vehicle of unknown type.
VEHICLE_TYPES = ("Car", "Van", "Truck", "Bus", "Motorcycle", "vehicle")
PERSON_TYPES = ("Pedestrian", "Cyclist")
# Types that are known not to be vehicles.
OTHER_TYPES = ("Cyclist", "Pedestrian", "Person_sitting", "Tram", "Misc", "DontCare")

# The classes that are detected and evaluated, and the types that belong to each class.
ObjectClass = Literal["vehicle", "pedestrian", "cyclist"]
VEHICLES: tuple[ObjectClass, ...] = ("vehicle",)
OBJECT_CLASSES: dict[str, tuple[str, ...]] = {
    "vehicle": VEHICLE_TYPES,
    "pedestrian": ("Pedestrian",),
    "cyclist": ("Cyclist",),
}
