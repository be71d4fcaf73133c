"""
A frame from above
==================

Test.
"""

import pyinfra as pi

frames = pi.simulate("highway", "helios_16", [100])
pi.plot_frame(frames[0])
