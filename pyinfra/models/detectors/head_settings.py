"""Settings of the centre head (centre_head.py); this module needs no PyTorch."""

import math

BOX = 8  # number of values of a box: x y z, log sizes (3), sine and cosine of heading
PEAKS = 512  # maximum number of peaks that become boxes, the highest first
# Weight of the road's axis if the predicted axis has length 0. A weight of 1 lowers AP by 0 to 2.
ROAD_WEIGHT = 3.0
# Angle that divides the two halves of a turn. It must be far from 0 and pi, because headings along
# the road are near 0 or pi.
PART = -math.pi / 4
