"""`pyinfra validate DATA/LIDAR [--pred DIR [--unlabelled]]`."""

import argparse
from pathlib import Path

from pyinfra.cli.messages import warn, with_options
from pyinfra.cli.parser import argument, usage
from pyinfra.core.errors import Error
from pyinfra.dataset.frames import has_labels, lidar_folder
from pyinfra.folders import trust, validate
from pyinfra.formats.csv_table import write_csv

add_arguments = usage(
    "Checks the frames of a data set and predictions for them, and reports common causes of "
    "an AP of 0.",
    "example: pyinfra validate data/highway/livox_avia --pred runs/pillars/predictions",
    argument("data", type=Path, help="folder of one LiDAR; without --pred also a data set"),
    argument("--pred", type=Path, help="folder of predictions, NNNNNN.txt or NNNNNN.csv"),
    argument(
        "--split",
        help="which frames must have predictions: the name of a list in ImageSets, such as val, or "
        "all; default: val if it exists, else all",
    ),
    argument("--allow-missing", action="store_true", help="allow frames without a prediction file"),
    argument(
        "--unlabelled",
        action="store_true",
        help="estimate without labels how reliable the predictions are; this is the default if "
        "the frames have no labels",
    ),
    argument("--out", type=Path, help="folder for trust.csv, the table of --unlabelled"),
)


def run(args: argparse.Namespace) -> int:
    findings = validate(args.data, args.pred, split=args.split, allow_missing=args.allow_missing)
    for level, name, text in findings.itertuples(index=False):
        print(with_options(f"{level}: {name}: {text}", args.options))
    if args.pred is not None and (args.unlabelled or not has_labels(lidar_folder(args.data))):
        _trust(args)
    elif args.unlabelled or args.out is not None:
        if args.pred is None:
            raise Error("--pred: expected a folder with --unlabelled or --out, got none")
        raise Error("--out: the frames have labels; add --unlabelled to ignore them, or omit --out")
    errors, warnings = ((findings.level == level).sum() for level in ("error", "warning"))
    print(f"{args.data}: {errors} errors, {warnings} warnings")
    return 1 if errors else 0


def _trust(args: argparse.Namespace) -> None:
    """Prints the label-free quality measures of the predictions.

    If --out is given, also writes them to trust.csv.
    """
    from pyinfra.models.inference.label_free_checks import NoQuality

    try:
        table = trust(args.data, args.pred, split=args.split, allow_missing=args.allow_missing)
    except NoQuality as error:
        if args.unlabelled or args.out is not None:
            raise
        warn(str(error), args)
        return
    frames = f"{lidar_folder(args.data)}: {table.frames[0]} frames"
    print(f"{frames}; shares of boxes by minimum score (without labels)")
    shown = table.drop(columns="frames")
    print(shown.to_string(index=False, float_format=lambda v: f"{v:.3g}", na_rep="-"))
    if args.out is not None:
        write_csv(args.out / "trust.csv", table)
