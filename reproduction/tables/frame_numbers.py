"""Makes the table of points per vehicle with frames_version 3 and 4 (results/frame_numbers.csv)."""

import pandas as pd

from reproduction.tables.common import Rows, interval, results, with_heads
from reproduction.tables.rungs import BANDS, LEAST_POINTS

PRODUCTS = {
    "helios_16": "Helios 16",
    "hesai_ot128": "OT128",
    "hesai_xt32": "XT32",
    "livox_avia": "Avia",
    "livox_horizon": "Horizon",
    "livox_mid_40": "Mid-40",
    "livox_mid_70": "Mid-70",
    "livox_tele_15": "Tele-15",
    "pandar_64": "Pandar64",
    "ruby_plus": "Ruby Plus",
    "velodyne_hdl_64e": "HDL-64E",
    "velodyne_vlp_16": "VLP-16",
    "velodyne_vlp_32c": "VLP-32C",
    "velodyne_vls_128": "VLS-128",
}
# Changes of each LiDAR besides the beam width, which is now modelled for all LiDARs.
REASONS = {
    "livox_avia": "had a divergence before; echoes are merged differently",
    "hesai_ot128": "3600 or 1800 columns instead of 2700; range of each channel",
    "hesai_xt32": "range of each channel",
    "livox_horizon": "exponent 0.5 instead of 0.25",
    "livox_mid_40": "exponent 0.5 instead of 0.25",
    "livox_mid_70": "exponent 0.5 instead of 0.25",
    "livox_tele_15": "exponent 0.28 instead of 0.25",
    "velodyne_hdl_64e": "1736 columns instead of 2031; exponent 0.42 instead of 0.25",
    "velodyne_vlp_16": "1808 columns instead of 1875",
    "velodyne_vlp_32c": "1808 columns instead of 1875",
}


@with_heads("LiDAR", *BANDS.values(), "other changes")
def frame_numbers() -> Rows:
    """Returns the ratio of the points per vehicle by LiDAR and distance.

    The ratio is that of frames_version 4 to 3. The scenes are pooled. An interval is over the
    traffic seeds.
    """
    table = results("frame_numbers")
    for when in ("before", "now"):
        table[f"all_{when}"] = table.vehicles * table[f"points_{when}"]
    sums = table.groupby(["lidar", "from_m", "seed"])[["vehicles", "all_before", "all_now"]].sum()
    for name, product in PRODUCTS.items():
        cells = []
        for from_m in BANDS:
            band: pd.DataFrame = sums.loc[(name, from_m)]
            if band.all_before.sum() < LEAST_POINTS * band.vehicles.sum():
                cells.append("below 1 point")
                continue
            ratio = interval(band.all_now / band.all_before)
            cells.append(f"{ratio.value:.2f} [{ratio.low:.2f}, {ratio.high:.2f}]")
        yield [product, *cells, REASONS.get(name, "")]
