"""`pyinfra train CONFIG DATA/LIDAR... --tier TIER --out RUN`."""

import argparse
import os
from dataclasses import replace
from pathlib import Path
from typing import get_args

from pyinfra.cli.messages import note, warn
from pyinfra.cli.parser import argument, usage
from pyinfra.core.errors import Error, refuse
from pyinfra.core.names import file_or_name
from pyinfra.core.vocabulary import TIERS
from pyinfra.dataset.catalogue import shipped
from pyinfra.dataset.regions import outline_region
from pyinfra.models.detectors.catalogue import DETECTORS
from pyinfra.models.training.accumulation import Accumulation, LabelAt
from pyinfra.models.training.recipe import Precision, Recipe, read_recipe
from pyinfra.models.training.sources import Source, Stream, read_source, simulated_source
from pyinfra.models.training.train import OF_NETWORKS, train

add_arguments = usage(
    "Trains a detector on frames. Run the same command again to resume.",
    "example: pyinfra train pointpillars data/highway/ruby_plus --tier quick --out runs/pillars",
    argument(
        "config",
        metavar="CONFIG",
        help="a detector's name, such as background or pointpillars, or a file as in "
        "configs/detectors",
    ),
    argument(
        "data",
        metavar="DATA",
        nargs="*",
        type=Path,
        help="folders of LiDARs whose training frames are used; or use --scene or --sites",
    ),
    argument(
        "--scene",
        help="scene, a file or a name; its frames are simulated during training (instead of DATA)",
    ),
    argument("--lidar", help="LiDAR, a file or a name; required with --scene"),
    argument(
        "--mount", default="", help="name of the mount; required if --scene has several mounts"
    ),
    argument(
        "--sites",
        metavar="FILE",
        help="stream, a name or a file as in configs/streams; random sites are simulated during "
        "training (instead of DATA)",
    ),
    argument("--preset", default="datasheet", help="preset of --lidar; default: datasheet"),
    argument(
        "--region",
        type=Path,
        metavar="FILE",
        help="YAML file with the outline of the area where vehicles can be, "
        "`outline_m: [[x, y], ...]`; only for the detector background; default: the roads of the "
        "data set",
    ),
    argument(
        "--start",
        type=Path,
        metavar="RUN",
        help="training folder, model file or name of a pretrained detector whose weights are the "
        "initial weights; default: `start` of the config",
    ),
    argument("--tier", choices=TIERS, default="quick", help="size of the training; default: quick"),
    argument(
        "--accumulate",
        type=int,
        default=1,
        metavar="N",
        help="merge N consecutive frames into one cloud; networks only; default: 1",
    ),
    argument(
        "--label-at",
        choices=get_args(LabelAt),
        default="newest",
        help="merged frame to which the labels belong; default: newest",
    ),
    argument("--out", type=Path, required=True, help="folder for the trained detector"),
    argument(
        "--seed",
        type=int,
        default=OF_NETWORKS["seed"],
        help=(
            "seed of the initial weights, the sample order and the augmentation; default: "
            f"{OF_NETWORKS['seed']}"
        ),
    ),
    argument(
        "--device", default=OF_NETWORKS["device"], help="cpu, cuda, cuda:1, ...; default: cpu"
    ),
    argument(
        "--precision",
        choices=get_args(Precision),
        default=OF_NETWORKS["precision"],
        help="number format of the network's layers; default: float32",
    ),
    argument(
        "--step-factor",
        dest="budget",
        type=float,
        default=OF_NETWORKS["budget"],
        help="number of steps as a multiple of the tier's steps; the learning rate schedule is "
        "scaled to the same length; default: 1",
    ),
)


def run(args: argparse.Namespace) -> int:
    refuse(
        (
            not 0 < args.budget <= 100,
            f"--step-factor: expected more than 0, at most 100, got {args.budget:g}",
        ),
        (args.seed < 0, f"--seed: expected 0 or more, got {args.seed}"),
    )
    recipe = read_recipe(file_or_name(args.config, shipped("detectors"), "CONFIG"), args.tier)
    if DETECTORS[recipe.detector].learnt:
        recipe = recipe.for_budget(args.budget)
        recipe = recipe.begun_with(args.start) if args.start is not None else recipe
    elif unused := [key for key, usual in OF_NETWORKS.items() if getattr(args, key) != usual]:
        words = ", ".join(f"`{key}`" for key in unused)
        note(f"{recipe.detector} does not use {words}", args)
    sources = _sources(args, recipe)
    if not isinstance(sources, Stream):
        sources = _with_region(args, recipe, sources)
        for warning in filter(None, (source.read_warning() for source in sources)):
            warn(f"other-types: {warning}", args)
    how = {name: getattr(args, name) for name in ("seed", "device", "precision")}
    model = train(recipe, sources, args.out, **how)
    if os.environ.get("RANK", "0") == "0":  # only the first of several processes prints the result
        print(model)
    return 0


def _with_region(args: argparse.Namespace, recipe: Recipe, sources: list[Source]) -> list[Source]:
    """Returns the sources, with the region of --region if this option is given.

    If the detector uses regions, prints a note for each source without a region.
    """
    if DETECTORS[recipe.detector].learnt or not recipe.network.within_region:
        if args.region is not None:
            raise Error(
                f"--region: expected no file for {recipe.detector}, got {args.region}; a "
                "region is only used by the detector background with network.within_region"
            )
        return sources
    if args.region is not None:
        region = outline_region(args.region)
        return [replace(source, region=region) for source in sources]
    for source in sources:
        if source.region is None:
            note(
                f"{recipe.detector}: {source.lidar}: no roads.csv and no `region`, so every moving "
                "object is taken for a vehicle",
                args,
            )
    return sources


def _sources(args: argparse.Namespace, recipe: Recipe) -> list[Source] | Stream:
    kinds = [bool(args.data), args.scene is not None, args.sites is not None]
    options = [f"--{key}" for key in ("scene", "lidar", "sites") if getattr(args, key)]
    given = " ".join([*["folders"][: len(args.data)], *options])
    refuse(
        (
            sum(kinds) != 1 or (args.scene is None) != (args.lidar is None),
            "DATA: expected one source of frames (folders, --scene with --lidar, or --sites), got "
            f"{given or 'none'}",
        ),
        (
            args.mount and args.scene is None,
            f"--mount: expected no mount without --scene, got '{args.mount}'",
        ),
        (
            args.mount == "fused",
            "--mount: expected the name of one mount, got 'fused'; to train on fused frames, run "
            "`infrasim run SCENE --fuse --out OUT` and give the folder OUT/fused/LIDAR as DATA",
        ),
    )
    accumulation = Accumulation(args.accumulate, args.label_at)
    if args.sites is not None:
        if accumulation.frames > 1:
            raise Error(
                f"--accumulate: expected 1 with --sites, got {accumulation.frames}; --sites "
                "simulates single frames"
            )
        from pyinfra.models.training.generated_sites import read_stream

        stream = file_or_name(args.sites, shipped("streams"), "sites")
        return read_stream(stream, recipe.classes)
    if args.scene is None:
        return [
            read_source(folder, args.tier, accumulation, recipe.classes) for folder in args.data
        ]
    how = {"preset": args.preset, "mount": args.mount}
    how |= {"accumulation": accumulation, "classes": recipe.classes}
    scene = file_or_name(args.scene, shipped("scenes"), "scene")
    lidar = file_or_name(args.lidar, shipped("lidars"), "lidar")
    return [simulated_source(scene, lidar, args.tier, **how)]
