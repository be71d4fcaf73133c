"""Quantiles of intervals are those of scipy.stats, whose import takes longer than most commands."""

import subprocess
import sys

import pytest
from scipy import stats

from pyinfra.metrics.intervals import ranks_of_median, student


@pytest.mark.parametrize("samples", [2, 3.7, 5, 30, 1e6])
def test_student_is_the_quantile_of_the_distribution(samples: float) -> None:
    for level in (0.8, 0.95, 0.99):
        assert student(samples, level) == stats.t.ppf((1 + level) / 2, samples - 1)


def test_ranks_of_a_median_are_those_of_the_binomial_distribution() -> None:
    for samples in range(1, 300):
        expected = stats.binom.interval(0.95, samples, 0.5)
        assert ranks_of_median(samples) == tuple(int(rank) for rank in expected)


def test_commands_start_without_scipy_stats() -> None:
    modules = "pyinfra.cli.evaluate, pyinfra.cli.detect, pyinfra.cli.track, pyinfra.cli.import_"
    code = f"import sys, {modules}; sys.exit('scipy.stats' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
