"""What learnt detectors share: overlap of boxes, sampling and search of points, sparse convolution.

Every operation is written in torch and runs where its tensors are; on a CPU some go through scipy
or the compiled extension instead, where benchmarks/ops.py shows that this is at least twice as
fast. Without the extension the torch code runs everywhere.
"""
