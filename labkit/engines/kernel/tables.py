"""Passes a NamedTuple of arrays to compiled code as a table of pointers, and restores the NamedTuple there.

The table has a pointer to each array, in the order of the fields, and a pointer to the lengths that are not fixed. The
host passes the table on or reads it as a struct. In functions that Numba compiles, `view` restores the NamedTuple.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from labkit.engines.kernel.translate import load_numba


class PointerTable:
    """The types and shapes of the arrays in a NamedTuple.

    Args:
        kind: The NamedTuple.
        sizes: Names of the lengths that are not fixed.
        fields: For each field the type of its numbers, `int` for 64 bits on any computer, "real" if it depends on the
            precision, and its lengths: numbers or names in `sizes`. A field without lengths is a single number.
    """

    def __init__(self, kind: type[Any], sizes: tuple[str, ...], **fields: tuple[Any, ...]) -> None:
        """Store the fields. Raises ValueError if their names differ from the fields of the NamedTuple."""
        if tuple(fields) != kind._fields:
            raise ValueError(f"{kind.__name__} has the fields {kind._fields}, not {tuple(fields)}")
        self.kind, self._sizes = kind, sizes
        self._fields = {name: (np.int64 if of is int else of, *lengths) for name, (of, *lengths) in fields.items()}

    def pointers(self, value: Any, real: type[np.floating]) -> Pointers:
        """Check the arrays of a NamedTuple and return its Pointers. Raises ValueError.

        Args:
            value: The NamedTuple.
            real: Type of the numbers that may be single.
        """
        sizes: dict[str, int] = {}
        arrays = []
        for name, (kind, *lengths) in self._fields.items():
            wanted = np.dtype(real if kind == "real" else kind)
            array = getattr(value, name)
            array = array if lengths else np.array(array, wanted)
            axes = zip(lengths, array.shape, strict=False)
            expected = [sizes.setdefault(n, m) if isinstance(n, str) else n for n, m in axes]
            fits = array.ndim == len(lengths) and list(array.shape) == expected
            if array.dtype != wanted or not fits or not array.flags.c_contiguous:
                raise ValueError(f"{self.kind.__name__}.{name}: {array.dtype} {array.shape}, not {wanted} {lengths}")
            arrays.append(array)
        arrays.append(np.array([sizes[name] for name in self._sizes], np.int64))
        return Pointers(arrays)

    def view(self, real: type[np.floating]) -> Any:
        """Return a function for Numba that converts a table to the NamedTuple."""
        names: dict[str, object] = {"carray": load_numba().carray, "kind": self.kind, "integer": np.int64}
        values = []
        for k, (name, (kind, *lengths)) in enumerate(self._fields.items()):
            names[name] = np.dtype(real if kind == "real" else kind).type
            shape = "".join(f"{n}, " if isinstance(n, int) else f"n[{self._sizes.index(n)}], " for n in lengths)
            values.append(f"carray(t[{k}], ({shape or '1,'}), {name})" + ("" if lengths else "[0]"))
        code = f"def view(t):\n    n = carray(t[{len(values)}], {max(1, len(self._sizes))}, integer)\n"
        exec(code + f"    return kind({', '.join(values)})\n", names)
        return names["view"]


class Pointers:
    """A table of pointers, with references that keep the arrays in memory; `address` is the address of the table."""

    def __init__(self, arrays: list[np.ndarray]) -> None:
        """Store the arrays and fill the table."""
        self._arrays = arrays
        self._table = np.array([array.ctypes.data for array in arrays], np.uint64)
        self.address: int = self._table.ctypes.data
