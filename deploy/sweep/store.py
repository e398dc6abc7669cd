"""Results on the disk: one Parquet file a task, PLACE/KEY.parquet, of one row."""

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from deploy.sweep.work import OK, Row
from protocol.document import check_is_file
from protocol.errors import InputError
from protocol.files import remove_parts, write_whole

TEXTS = ("key", "status", "reason", "settings", "revision")
"""Columns that each result has; all others are figures, or missing."""
MAX_COLUMNS, MAX_ROW_BYTES = 10_000, 1 << 28
"""Of a result, which has some hundred columns and kilobytes."""


class Store:
    """Results by their keys."""

    def __init__(self, place: Path, revision: str) -> None:
        """Make the folder. revision: of the sources, which stands in each result. Raises OSError."""
        self.place, self._revision = place, revision
        self.place.mkdir(parents=True, exist_ok=True)

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Fill it while no other process does. Raises InputError where one does, and OSError.

        Two would make each run twice, and the later one would take the other's unfinished file for what a killed one
        left. The system gives the lock back when its process dies.
        """
        with (self.place / ".lock").open("ab") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InputError(
                    f"{self.place}: another process fills it; wait for its end, or take another folder"
                ) from None
            remove_parts(self.place)
            yield

    def kept(self) -> set[str]:
        """Keys of the results that are there."""
        return {file.stem for file in self.place.glob("*.parquet")}

    def failed(self) -> set[str]:
        """Keys of those that failed."""
        return {str(row["key"]) for row in read_rows(self.place) if row["status"] != OK}

    def row(self, key: str) -> Row:
        """The result of this key. Raises InputError where it is not there."""
        return read_row(self.place / f"{key}.parquet")

    def keep(self, row: Row) -> None:
        """Write a row, whole or not at all. Raises UnwritableError."""
        columns = {
            name: pa.array([value], _kind(value)) for name, value in ({"revision": self._revision} | row).items()
        }
        sink = pa.BufferOutputStream()
        parquet.write_table(pa.table(columns), sink, use_dictionary=False, write_statistics=False, store_schema=False)
        write_whole(self.place / f"{row['key']}.parquet", sink.getvalue().to_pybytes())


def _kind(value: object) -> pa.DataType:
    """Numbers and missing ones are float64, so that a column has one type in all files."""
    return pa.string() if isinstance(value, str) else pa.float64()


def read_rows(folder: Path) -> Iterator[Row]:
    """The results in a folder and below, by path. Raises InputError where a file is none."""
    return map(read_row, sorted(folder.rglob("*.parquet")))


def read_row(file: Path) -> Row:
    """The result in a file. Raises InputError where it is none."""
    try:
        check_is_file(file)
        with file.open("rb") as stream:  # a path with a colon is an address to pyarrow
            kept = parquet.ParquetFile(stream)
            about = kept.metadata
            if about.num_rows != 1 or about.num_columns > MAX_COLUMNS:
                raise ValueError(f"it has {about.num_rows} rows of {about.num_columns} columns")
            if sum(about.row_group(k).total_byte_size for k in range(about.num_row_groups)) > MAX_ROW_BYTES:
                raise ValueError(f"its row has more than {MAX_ROW_BYTES >> 20} MB")
            (row,) = kept.read(use_threads=False).to_pylist()  # its threads outlive Python: 6 of 24 commands aborted
        if not all(isinstance(row.get(name), str) for name in TEXTS):
            raise ValueError(f"it needs texts as {', '.join(TEXTS)}")
        for name in ("settings", "config"):
            if not isinstance(text := row.get(name, "{}"), str) or not isinstance(json.loads(text), dict):
                raise ValueError(f"its {name} is no JSON object")
    except (OSError, ValueError, RecursionError, pa.ArrowException) as error:
        raise InputError(f"{file}: no result of a sweep: {error}") from None
    return dict(row)
