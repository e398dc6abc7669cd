"""Results of sweeps on the disk: one Parquet file a run, FOLDER/REVISION/KEY.parquet, of one row."""

from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from deploy.sweep.measure import OK, Row
from protocol.errors import InputError
from protocol.files import remove_parts, write_whole


class Store:
    """The results of one revision of the sources."""

    def __init__(self, folder: Path, revision: str) -> None:
        """Make the folder. Raises OSError."""
        self.place, self._revision = folder / revision, revision
        self.place.mkdir(parents=True, exist_ok=True)
        remove_parts(self.place)

    def kept(self) -> set[str]:
        """Keys of the runs that are there."""
        return {file.stem for file in self.place.glob("*.parquet")}

    def failed(self) -> set[str]:
        """Keys of those that failed."""
        return {str(row["key"]) for row in read_rows(self.place) if row["status"] != OK}

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
    for file in sorted(folder.rglob("*.parquet")):
        try:
            (row,) = parquet.ParquetFile(file).read().to_pylist()
            if not row.keys() >= {"key", "status", "reason", "settings", "revision"}:
                raise ValueError("columns are missing")
        except (OSError, ValueError, pa.ArrowException) as error:
            raise InputError(f"{file}: no result of a sweep: {error}") from None
        yield row
