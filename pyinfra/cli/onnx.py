"""`pyinfra onnx RUN --out FILE.onnx`."""

import argparse
from pathlib import Path

from pyinfra.api import export_onnx
from pyinfra.cli.parser import argument, usage

add_arguments = usage(
    "Exports a dense detector, from points to boxes, as one ONNX file that includes the "
    "suppression of overlapping boxes. z of points and boxes is the height above the road, "
    "and scores are not calibrated.",
    "example: pyinfra onnx runs/pillars --out pillars.onnx",
    argument("model", metavar="RUN", type=Path, help="output folder of `pyinfra train`"),
    argument("--out", type=Path, required=True, help=".onnx file to write"),
)


def run(args: argparse.Namespace) -> int:
    print(export_onnx(args.model, args.out))
    return 0
