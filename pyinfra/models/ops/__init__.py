"""Operations of the networks: overlap of boxes, point sampling and search, sparse convolution.

All operations are written in PyTorch and run on the device of their tensors. On a CPU some
operations use SciPy or the compiled extension instead. benchmarks/ops.py shows that these are at
least twice as fast. If the extension is not installed, the PyTorch code is used.
"""
