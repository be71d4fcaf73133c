"""Operations of the networks: overlap of boxes, point sampling and search, sparse convolution.

All operations are written in PyTorch and run on the device of their tensors. On a CPU some use
SciPy or the compiled extension instead, where benchmarks/ops.py shows that this is at least twice
as fast. Without the extension the PyTorch code is used.
"""
