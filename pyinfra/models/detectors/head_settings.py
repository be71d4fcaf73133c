"""Settings of the centre head (centre_head.py); this module needs no PyTorch."""

import math

BOX = 8  # x y z, log sizes (3), sine and cosine of the heading
PEAKS = 512  # number of highest peaks that become boxes
# Weight of the road's axis if the predicted axis has length 0. A weight of 1 lowers AP by 0 to 2.
ROAD_WEIGHT = 3.0
# Angle that divides the two halves of a turn. Headings along the road are near 0 or pi, so this
# angle must be far from both.
PART = -math.pi / 4
