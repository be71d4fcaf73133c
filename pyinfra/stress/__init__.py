"""Where detectors fail: dials from none to breaking, and what breaks first."""
