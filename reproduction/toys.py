"""Commands of the steps at a toy size, to try the engine. NAME=VALUE replaces a constant."""

TOYS = {
    "experiments.csv": (
        "experiments \"TRAIN_FRAMES='0:400:40'\" \"TEST_FRAMES='0:400:40'\" --scenes "
        "highway --presets paper --setups background --replicates 3"
    ),
    "coverage.csv": "coverage \"SCENES=('highway',)\" --studies 2",
    "correlation.csv": "correlation \"SCENES=('highway',)\" \"LIDARS=('helios_16',)\"",
    "detectability.csv": "detectability --fit 0 --check 2 --frames 3",
    "placement.csv": "placement {detectability.csv} --sites 2 --unit-sites 2 --frames 3",
    "plans.csv": "plans QUESTIONS=QUESTIONS[:1] CHECK_FRAMES=2",
    "plan_coverage.csv": (
        "plan_coverage CALIBRATION_SITES=0 --sites 1 --seeds 2 --frames 3 --check-frames 3"
    ),
    "places.csv": (
        "places \"FRAMES='0:5000:1000'\" 'SEEDS=(1,2)' \"PLACES=('back','4m')\" "
        "'RUNS={name:RUNS[name]for(name)in(PLACES)}' --lidars hesai_xt32"
    ),
    "poles.csv": (
        "poles \"TRAINING_FRAMES='0:400:40'\" \"TEST_FRAMES='5000:5400:100'\" --seeds 1 "
        "--lidars helios_16 --detectors background --errors none"
    ),
    "stress_seeds.csv": (
        "stress \"FRAMES='0:5000:100'\" TEST_FRAMES=2 \"LIDARS=('ruby_plus',)\" "
        "STRESSORS=STRESSORS[:1] --seeds 1 --setups background"
    ),
    "ladder.csv": "ladder --seeds 1 --lidars helios_16 --settings frames --frames 50",
    "fairness.csv": "fairness generalist --scenes highway --lidars livox_avia",
    "unseen.csv": "unseen generalist --sites 1 --frames 1",
    "detector_goals.csv": "detector_goals generalist-3 generalist --sites 1 1 --frames 1",
    "rungs.csv": (
        "rungs 'FRAMES=range(0,60,30)' \"SCENES=('highway',)\" --seeds 1 --rungs 'one ray'"
    ),
    "rungs_ap.csv": "rungs_ap \"FRAMES='0:5000:200'\" \"DETECTORS=('background',)\" --seeds 1",
    "tracks.csv": "tracks FRAMES=20 TIMED=2 --scenes highway --lidars helios_16 --seeds 1",
    "fidelity.csv": "fidelity --frames 2",
    "latency.csv": "latency \"TEST_FRAMES='0:400:100'\" --setups pretrained --lidars livox_avia",
    "speed.csv": "benchmarks/run.py --repetitions 1",
    "evaluation.csv": "benchmarks/evaluate_speed.py --frames 2",
    "ops.csv": "benchmarks/ops.py --repetitions 1",
    "growth.csv": "benchmarks/growth.py --only vehicles",
    "scanning_claims.csv": "scanning --seeds 1 --frames 0:70:7",
    "deskew.csv": "deskew --seeds 1 --frames 0:70:7",
    "claims.csv": "verdicts {experiments.csv}",
    "variance.csv": "variance {experiments.csv}",
}
