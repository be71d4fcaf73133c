"""Detectors, evaluation and reports for roadside LiDAR frames."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("infrasim")
except PackageNotFoundError:  # a source tree that was not installed
    __version__ = "0+source"
