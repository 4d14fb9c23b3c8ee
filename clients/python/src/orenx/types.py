"""Names of types that the whole package uses."""

from __future__ import annotations

from typing import Union

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]
I8 = NDArray[np.int8]
I32 = NDArray[np.int32]
Bool = NDArray[np.bool_]
Bytes = Union[bytes, bytearray, memoryview]
