"""Type aliases of NumPy arrays. Each function documents the shapes, units and frames it uses."""

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
NameArray = npt.NDArray[np.str_]

Points = npt.NDArray[np.float32]  # points (n, 4) x y z intensity, or (n, 3) x y z
Float32Array = npt.NDArray[np.float32]
Int32Array = npt.NDArray[np.int32]
Records = npt.NDArray[np.void]  # structured array (n,), such as the fields of n points

Floats = npt.NDArray[np.floating]  # float32 for large arrays such as clouds, else float64
AnyArray = npt.NDArray[Any]
# Decorator for functions that read numbers from files before checking them. It suppresses NumPy's
# warnings, for example about signalling NaN.
unchecked = np.errstate(invalid="ignore", over="ignore")
