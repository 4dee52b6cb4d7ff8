"""The trace of a run: what the axes and outputs did, sample by sample, in an HDF5 file.

The layout is described in the simulator's README; rows describe the state at the end of their sample.
"""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

import h5py
import numpy as np
from numpy.typing import NDArray

FORMAT = "ibfctl-simulator-trace/1"
CHUNK_ROWS = 8192


class TraceWriter:
    """Appends rows to a trace file; use it as a context manager or call `close`.

    Raises
    ------
    OSError
        If the file cannot be created.
    """

    def __init__(self, path: Path, axes: str, sample_period_s: float) -> None:
        self._file = h5py.File(path, "w")
        self._file.attrs["format"] = FORMAT
        self._file.attrs["axes"] = axes
        self._file.attrs["sample_period_s"] = sample_period_s
        self._dataset("sample", (), np.int64)
        self._dataset("position_counts", (len(axes),), np.int32)
        self._dataset("commanded_counts", (len(axes),), np.int32)
        self._dataset("outputs", (), np.uint32)
        self._waiting: list[dict[str, NDArray[np.generic]]] = []
        self._waiting_rows = 0
        self._rows = 0

    def append(
        self,
        sample: NDArray[np.int64],
        position_counts: NDArray[np.int64],
        commanded_counts: NDArray[np.int64],
        outputs: int,
    ) -> None:
        """Add rows.

        Parameters
        ----------
        sample : (n,) absolute sample indices
        position_counts, commanded_counts : (n, axes)
        outputs : bit k-1 is output k; the same for all rows
        """
        self._waiting.append(
            {
                "sample": sample,
                "position_counts": position_counts.astype(np.int32),
                "commanded_counts": commanded_counts.astype(np.int32),
                "outputs": np.full(len(sample), outputs & 0xFFFF_FFFF, dtype=np.uint32),
            }
        )
        self._waiting_rows += len(sample)
        if self._waiting_rows >= CHUNK_ROWS:
            self._write()

    def close(self) -> None:
        """Write what waits and close the file."""
        if self._file:
            self._write()
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self.close()

    def _dataset(self, name: str, row: tuple[int, ...], dtype: type[np.generic]) -> None:
        self._file.create_dataset(
            name,
            shape=(0, *row),
            maxshape=(None, *row),
            chunks=(CHUNK_ROWS, *row),
            dtype=dtype,
            compression="gzip",
            compression_opts=1,
            shuffle=True,
        )

    def _write(self) -> None:
        if not self._waiting:
            return
        last = self._rows + self._waiting_rows
        for name in ("sample", "position_counts", "commanded_counts", "outputs"):
            dataset = self._file[name]
            dataset.resize(last, axis=0)
            dataset[self._rows : last] = np.concatenate([rows[name] for rows in self._waiting])
        self._file.flush()
        self._rows, self._waiting, self._waiting_rows = last, [], 0
