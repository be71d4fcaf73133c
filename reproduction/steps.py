"""The steps that make the files of results/, and the CPU hours of each step.

CPU hours are those of two cores of an AMD EPYC or Intel Xeon. Each value names its source: a
recorded column (`train_cpu_s`, `cpu_s`, `detector_ms`), to which an estimate of simulation and
tests is added, or a trial at a small size. After a run, results/steps.csv has the measured values.
"""

from reproduction.engine import Command, Step

TRIAL = "trial at a small size"
TRAINING = "column train_cpu_s, and 24 s for two tests"
ESTIMATE = "frames times 0.1 s"
RUN = "parts that were run"
TIMES = "trial at a small size, which only measures times"
SCENES = ("--scenes", ("highway", "crossroad", "curve"))
HIGHWAY = ("--scenes", ("highway",))
OTHER_SCENES = ("--scenes", ("crossroad", "curve"))
PRESETS = ("--presets", ("paper", "datasheet"))
SEEDS = ("--seeds", ("1", "2", "3"))
THREE_REPLICATES = ("1", "2", "3")
FIVE_REPLICATES = (*THREE_REPLICATES, "4", "5")

# Files of results/ that no step makes, and the command or version that makes each file.
OTHERS = {
    "dataset.csv": "make dataset",
    "debian13.csv": "make debian13",
    "detector_pilots.csv": "a program of version 798cdb0f",
    "follow.csv": "python -m reproduction follow, which takes an hour",
    "frame_numbers.csv": "python -m reproduction frame_numbers, with an earlier checkout",
    "generalist_sites.csv": "make generalist",
    "gpu.csv": "python -m reproduction gpu, with a GPU",
    "impossible_sites.csv": "tests/python/impossible_sites.py",
    "lidars.csv": "prices, by hand from their sources",
    "sites.csv": "python -m reproduction sites, with maps of CARLA's towns",
    "steps.csv": "make results",
    "traffic.csv": "python -m reproduction traffic, with imported towns",
}


def experiments(
    words: str,
    cpu_h: float,
    *split: tuple[str, tuple[str, ...]],
    source: str = TRAINING,
    replicates: tuple[str, ...] = THREE_REPLICATES,
    secondary: bool = False,
) -> Command:
    """Returns a command of `experiments`, split by replicate.

    The commands share frames and trainings. No two of them train the same detector.
    """
    uses = "fine-tuned" in words or "pretrained" in words
    split = (*split, ("--only", replicates))
    file = "experiments.csv"
    words = f"experiments {words}"
    return Command(
        words, cpu_h, source, "experiments", uses, file, split=split, secondary=secondary
    )


PAPER = "--scenes highway --presets paper"
TURNED = "--cut-angles 0 90 180 270"
PRIMARY = "--setups fine-tuned background"


STEPS = (
    Step(
        ("experiments.csv",),
        (
            experiments(f"{PAPER} {PRIMARY} {TURNED}", 1.5, source=RUN, replicates=FIVE_REPLICATES),
            experiments(
                f"--scenes highway --presets datasheet {PRIMARY}",
                1.0,
                source=RUN,
                replicates=FIVE_REPLICATES,
            ),
            experiments(
                f"--scenes crossroad curve {PRIMARY}",
                5.0,
                OTHER_SCENES,
                PRESETS,
                source=RUN,
                replicates=FIVE_REPLICATES,
            ),
            experiments("--setups pointpillars", 3.3, HIGHWAY, PRESETS, source=RUN),
            experiments(
                "--scenes highway --presets datasheet --setups fine-tuned --law-exponents 0.5",
                0.6,
                source=RUN,
            ),
            experiments("--setups pretrained", 0.5, SCENES, PRESETS),
            experiments(
                f"{PAPER} --setups pv-rcnn dsvt pointrcnn --lidars ruby_plus livox_avia",
                1.9,
                source=RUN,
                replicates=("1",),
                secondary=True,
            ),
            experiments(f"{PAPER} {PRIMARY} --label-times frame {TURNED}", 0.7),
            experiments(
                f"{PAPER} --setups fine-tuned --label-times frame {TURNED} "
                "--training-cut-angles 90 180",
                0.9,
                secondary=True,
            ),
        ),
    ),
    Step(
        ("claims.csv",),
        (
            Command(
                "verdicts {experiments.csv}",
                0.002,
                TRIAL,
                out="claims.csv",
            ),
        ),
    ),
    Step(
        ("variance.csv",),
        (
            Command(
                "variance {experiments.csv}",
                0.002,
                TRIAL,
                out="variance.csv",
            ),
        ),
    ),
    Step(
        ("scanning_claims.csv",),
        (
            Command(
                "scanning --seeds 1 2 3 4 5",
                0.3,
                TRIAL,
                "scanning",
                out="scanning_claims.csv",
            ),
        ),
    ),
    Step(("deskew.csv",), (Command("deskew", 0.2, TRIAL, "deskew", out="deskew.csv"),)),
    Step(("coverage.csv",), (Command("coverage", 0.2, TRIAL, "coverage", out="coverage.csv"),)),
    Step(
        ("correlation.csv",),
        (Command("correlation", 0.1, TRIAL, "correlation", out="correlation.csv"),),
    ),
    Step(
        ("detectability.csv", "detectability_summary.csv", "detectability_reliability.csv"),
        (
            Command(
                "detectability --fit 0 --check 13",
                1.0,
                ESTIMATE,
                "detectability",
                True,
                "detectability.csv",
            ),
        ),
    ),
    Step(
        ("placement.csv", "placement_order.csv", "placement_summary.csv"),
        (
            Command(
                "placement {detectability.csv} --sites 5",
                0.9,
                ESTIMATE,
                "detectability",
                True,
                "placement.csv",
            ),
        ),
    ),
    Step(
        ("plans.csv",),
        (Command("plans", 0.3, "column cpu_s", "plans", True, "plans.csv"),),
    ),
    Step(
        ("plan_coverage.csv", "plan_coverage_summary.csv"),
        (Command("plan_coverage", 1.8, ESTIMATE, "plan_coverage", True, "plan_coverage.csv"),),
    ),
    Step(
        ("places.csv",),
        (Command("places", 0.2, ESTIMATE, "places", True, "places.csv"),),
    ),
    Step(
        ("poles.csv",),
        (Command("poles", 4.2, RUN, "poles", False, "poles.csv", split=(SEEDS,)),),
    ),
    Step(
        ("stress_seeds.csv",),
        (Command("stress", 0.9, ESTIMATE, "stress", True, "stress_seeds.csv", split=(SEEDS,)),),
    ),
    Step(
        ("integration.csv",),
        (
            Command(
                "integration --lidars livox_avia",
                1.1,
                TRAINING,
                "integration",
                False,
                "integration.csv",
                split=(SEEDS, ("--speeds", ("20", "62"))),
            ),
        ),
    ),
    Step(
        ("ladder.csv",),
        (Command("ladder", 0.4, ESTIMATE, "ladder", False, "ladder.csv", split=(SEEDS,)),),
    ),
    Step(
        ("fairness.csv",),
        (
            Command(
                "fairness generalist --scenes highway",
                0.2,
                TRAINING,
                "fairness",
                True,
                "fairness.csv",
            ),
        ),
    ),
    Step(
        ("generalist.csv",),
        (
            Command(
                "generalist", 1.2, TRAINING, "generalist", True, "generalist.csv", secondary=True
            ),
        ),
    ),
    Step(
        ("unseen.csv",),
        (Command("unseen generalist --frames 3", 0.4, TRIAL, model=True, out="unseen.csv"),),
    ),
    Step(
        ("detector_goals.csv",),
        (
            Command(
                "detector_goals generalist-3 generalist",
                1.0,
                ESTIMATE,
                model=True,
                out="detector_goals.csv",
            ),
        ),
    ),
    Step(("rungs.csv",), (Command("rungs", 0.2, TRIAL, out="rungs.csv"),)),
    Step(
        ("rungs_ap.csv",),
        (Command("rungs_ap", 0.3, ESTIMATE, "rungs_ap", True, "rungs_ap.csv"),),
    ),
    Step(
        ("tracks.csv",),
        (
            Command(
                "tracks --seeds 1 2 3",
                0.9,
                "column detector_ms",
                "tracks",
                True,
                "tracks.csv",
                split=(("--scenes", ("highway", "crossroad", "curve", "crossroad_poles")),),
            ),
        ),
    ),
    Step(("people.csv",), (Command("people", 0.01, TRIAL, out="people.csv"),)),
    Step(
        ("fidelity.csv", "aggregation.csv"),
        (Command("fidelity", 0.06, TRIAL, out="."),),
    ),
    Step(
        ("latency.csv",),
        (
            Command(
                "latency --setups pretrained background fine-tuned pointpillars pv-rcnn dsvt "
                "pointrcnn --lidars ruby_plus livox_avia",
                0.2,
                ESTIMATE,
                "experiments",
                True,
                "latency.csv",
                alone=True,
            ),
        ),
    ),
    Step(
        ("detector_latency.csv",),
        (
            Command(
                "detector_latency",
                0.1,
                ESTIMATE,
                "detector_latency",
                True,
                "detector_latency.csv",
                alone=True,
            ),
        ),
    ),
    Step(
        ("onnx_files.csv",),
        (Command("onnx_files", 0.3, TRAINING, "onnx_files", True, "onnx_files.csv", alone=True),),
    ),
    Step(
        ("speed.csv",),
        (Command("benchmarks/run.py", 0.1, ESTIMATE, out="speed.csv", alone=True),),
    ),
    Step(
        ("evaluation.csv",),
        (Command("benchmarks/evaluate_speed.py", 0.02, TRIAL, out="evaluation.csv", alone=True),),
    ),
    Step(
        ("ops.csv",),
        (Command("benchmarks/ops.py", 0.02, TRIAL, out="ops.csv", alone=True),),
    ),
    Step(
        ("growth.csv",),
        (Command("benchmarks/growth.py", 0.1, ESTIMATE, out="growth.csv", alone=True),),
    ),
)
