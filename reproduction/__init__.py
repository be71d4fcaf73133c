"""The study: what repeats and tests the paper's results, and what makes the tables of the docs.

Run from the root of a checkout as `python -m reproduction COMMAND ...`; no part of the wheel.
"""

from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
