"""The process that reads HDF5, Parquet and MATLAB files for sandbox.py: it may run out of memory, or crash.

Run as a script, it imports nothing of this package. A request is one line of JSON on standard input; the answer on
standard output is the length of a header (8 bytes, little endian), the header as JSON, and the arrays that it lists.
Headers are checked against the budget before anything is read.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, BinaryIO

import numpy as np

MOST_NAMES = 10_000  # members of a group, or columns of a table
DEEPEST = 8  # groups below groups
MOST_TEXTS = 100_000  # strings in a dataset
ATTRIBUTE_BYTES = 1 << 20
MOST_ATTRIBUTES = 256
MEMORY_BUDGETS = 3  # how many times the budget of values may be taken to read them
SPARE_BYTES = 256 << 20

Answer = tuple[dict[str, Any], list[Any]]


class Refused(Exception):  # noqa: N818 - named for what it does to the file
    """What was found, expected, the likely cause and the remedy, as the parent words it."""

    def __init__(self, place: str, found: str, expected: str, cause: str, remedy: str) -> None:
        super().__init__(found)
        self.parts = {
            "place": place,
            "found": found,
            "expected": expected,
            "cause": cause,
            "remedy": remedy,
        }


class Budget:
    """Bytes of values that may still be read."""

    def __init__(self, most: int) -> None:
        self._most = self._left = most

    def take(self, size: int, place: str) -> None:
        """Take `size` bytes; raises Refused where that is more than what is left."""
        self._left -= size
        self.check(self._most - self._left, place)

    def check(self, size: int, place: str) -> None:
        """Raise Refused where `size` bytes are more than there ever were."""
        if size > self._most:
            raise Refused(
                place,
                f"{size / 2**20:.6g} MB declared",
                f"at most {self._most / 2**20:.6g} MB of values in one file",
                "a damaged or forged header, or a record of many flights",
                "copy the file again, cut it into flights, or lower the sample rate",
            )


def main() -> None:
    """Answer requests until standard input ends."""
    answers, requests = sys.stdout.buffer, sys.stdin.buffer
    sys.stdout = sys.stderr  # what a library prints must not mix with the answers
    for line in requests:
        request = json.loads(line)
        try:
            _limit(request["budget"], request["seconds"])
            header, arrays = _READERS[request["kind"]](request, Budget(request["budget"]))
        except Refused as refused:
            header, arrays = {"refused": refused.parts}, []
        except MemoryError:
            header, arrays = {"memory": True}, []
        except Exception as error:  # the libraries raise errors of every kind on damaged files
            header, arrays = {"library": f"{type(error).__name__}: {error}"}, []
        _send(answers, header, arrays)


def _send(stream: BinaryIO, header: dict[str, Any], arrays: list[Any]) -> None:
    text = json.dumps(header).encode("ascii")
    stream.write(len(text).to_bytes(8, "little") + text)
    for array in arrays:
        stream.write(np.ascontiguousarray(array).tobytes())
    stream.flush()


def _limit(budget: int, seconds: int) -> None:
    """Let the system end this process where it takes too much memory or time for one file."""
    try:
        import resource
    except ImportError:  # a system without such limits: the parent still has its own clock
        return
    _lower(resource.RLIMIT_CORE, 0)
    _lower(resource.RLIMIT_CPU, math.ceil(time.process_time()) + seconds)
    try:
        with open("/proc/self/statm", encoding="ascii") as stream:
            address_space = int(stream.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return
    _lower(resource.RLIMIT_AS, address_space + MEMORY_BUDGETS * budget + SPARE_BYTES)


def _lower(what: int, limit: int) -> None:
    import resource

    hard = resource.getrlimit(what)[1]
    resource.setrlimit(what, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))


# HDF5 -------------------------------------------------------------------------------------------------------------


def _hdf5(request: dict[str, Any], budget: Budget) -> Answer:
    """Groups, their attributes and the datasets asked for; the names of all others."""
    import h5py

    path = request["path"]
    if not h5py.is_hdf5(path):
        raise Refused(
            "",
            "a file that is not HDF5",
            "a flight record (format 1)",
            "a text table or MATLAB file, a truncated copy, or no permission to read",
            "bring a foreign record in with `brv-hypo import`, or copy the file again",
        )
    walk = _Walk(request["only"], budget)
    with h5py.File(path, "r") as file:
        walk.group(file, "", False, ())
    return {"groups": walk.groups, "datasets": walk.datasets}, walk.arrays


class _Walk:
    """One pass over a file's groups; only what is requested is opened."""

    def __init__(self, only: dict[str, list[str] | None] | None, budget: Budget) -> None:
        self._only = {"": None} if only is None else only
        self._budget = budget
        self.groups: dict[str, dict[str, Any]] = {}
        self.datasets: list[dict[str, Any]] = []
        self.arrays: list[Any] = []

    def group(self, group: Any, place: str, whole: bool, above: tuple[Any, ...]) -> None:
        """Note the group at `place`; `whole` takes all that is below it."""
        import h5py

        info = h5py.h5o.get_info(group.id)
        here = (info.fileno, info.addr)
        if here in above or len(above) > DEEPEST:
            raise Refused(
                f"group '{place}'",
                "a group that holds itself"
                if here in above
                else f"more than {DEEPEST} groups in one another",
                "a tree of groups",
                "a forged or damaged file",
                "write the record anew from its source",
            )
        whole = whole or self._only.get(place, ()) is None
        unread: list[str] = []
        self.groups[place] = {"attributes": dict(_attributes(group, place)), "unread": unread}
        for name in _names(group, place):
            inner = f"{place}/{name}".lstrip("/")
            wanted = whole or name in (self._only.get(place) or ())
            passed = whole or any(key == inner or key.startswith(f"{inner}/") for key in self._only)
            self._member(group, name, inner, wanted, passed, whole, (*above, here), unread)

    def _member(
        self,
        group: Any,
        name: str,
        place: str,
        wanted: bool,
        passed: bool,
        whole: bool,
        above: tuple[Any, ...],
        unread: list[str],
    ) -> None:
        """One member of a group: a dataset to read, a group to enter, or a name to note."""
        import h5py

        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            if wanted and not whole:
                raise Refused(
                    f"dataset '{place}'",
                    "a link to another place",
                    "the dataset itself",
                    "a file that collects others",
                    "copy what it links to into the file (`h5repack` or `h5copy`)",
                )
            unread.append(name)
            return
        if not (wanted or passed):
            if _kind(group, name) is not h5py.Group:
                unread.append(name)
            return
        item = group[name]
        if isinstance(item, h5py.Dataset):
            if wanted:
                self._dataset(item, place)
            else:
                unread.append(name)
        elif isinstance(item, h5py.Group) and passed:
            self.group(item, place, whole, above)

    def _dataset(self, item: Any, place: str) -> None:
        """Check the header, then read."""
        import h5py

        self._check_storage(item, place)
        entry: dict[str, Any] = {"place": place, "shape": list(item.shape)}
        if "units" in item.attrs:
            entry["units"] = _attribute(item, "units")
        if h5py.check_string_dtype(item.dtype) is not None:
            if item.size > MOST_TEXTS:
                raise _too_many(f"dataset '{place}'", item.size, "texts", MOST_TEXTS, "header")
            entry["texts"] = np.asarray(item.asstr(errors="replace")[()]).reshape(-1).tolist()
        else:
            self._budget.take(item.size * item.dtype.itemsize, f"dataset '{place}'")
            values = np.asarray(item[()])
            if values.dtype.kind == "b":
                values = values.astype(np.uint8)
            entry["dtype"] = values.dtype.str
            self.arrays.append(values)
        self.datasets.append(entry)

    def _check_storage(self, item: Any, place: str) -> None:
        """Raise Refused unless the dataset holds numbers or text, in this file, in pieces of a sane size."""
        import h5py

        readable = item.dtype.kind in "fiubc" or h5py.check_string_dtype(item.dtype) is not None
        if item.shape is None or not readable:
            raise Refused(
                f"dataset '{place}'",
                f"values of type {item.dtype}" if item.shape is not None else "no values",
                "numbers",
                "text, or a compound or reference type",
                "write it as floating-point numbers",
            )
        if item.is_virtual or item.external:
            raise Refused(
                f"dataset '{place}'",
                "values that lie in other files",
                "values in the file itself",
                "a file that collects others",
                "copy the values into one file (`h5repack`)",
            )
        if item.chunks is not None:
            self._budget.check(math.prod(item.chunks) * item.dtype.itemsize, f"dataset '{place}'")


def _too_many(place: str, count: int, things: str, most: int, damaged: str = "file") -> Refused:
    cause = f"a damaged or forged {damaged}"
    return Refused(place, f"{count} {things}", f"at most {most}", cause, "write the record anew")


def _kind(group: Any, name: str) -> Any:
    """The class of a member that is not requested; None where even that cannot be determined."""
    try:
        return group.get(name, getclass=True)
    except Exception:  # damage in what is not asked for does not matter
        return None


def _names(group: Any, place: str) -> list[str]:
    if len(group) > MOST_NAMES:
        raise _too_many(f"group '{place}'", len(group), "members", MOST_NAMES)
    return list(group)


def _attributes(item: Any, place: str) -> Iterator[tuple[str, Any]]:
    if len(item.attrs) > MOST_ATTRIBUTES:
        raise _too_many(f"group '{place}'", len(item.attrs), "attributes", MOST_ATTRIBUTES)
    for name in item.attrs:
        yield name, _attribute(item, name)


def _attribute(item: Any, name: str) -> Any:
    """Text, a number, a list of these; for anything else a text that says what it is."""
    stored = item.attrs.get_id(name)
    kind = stored.dtype.kind
    if kind not in "fiubSO" or stored.shape is None:
        return f"<{stored.dtype}>"
    if math.prod(stored.shape) * stored.dtype.itemsize > ATTRIBUTE_BYTES:
        return f"<{math.prod(stored.shape)} values>"
    return _plain(item.attrs[name])


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode("utf-8", errors="replace")
    if isinstance(value, np.ndarray):
        return _plain(value.reshape(-1)[0]) if value.size == 1 else [_plain(one) for one in value.reshape(-1)]
    if isinstance(value, np.generic):
        return _plain(value.item())
    return value if isinstance(value, bool | int | float | str) else f"<{type(value).__name__}>"


# Tables -----------------------------------------------------------------------------------------------------------


def _parquet(request: dict[str, Any], budget: Budget) -> Answer:
    """The columns asked for, as floating-point numbers; the names of all."""
    import pyarrow as pa
    from pyarrow import parquet

    file = parquet.ParquetFile(request["path"])
    names = [str(name) for name in file.schema_arrow.names]
    columns = []
    for name in request["names"]:
        if name not in names:
            continue
        budget.take(8 * max(file.metadata.num_rows, 0), f"dataset '{name}'")
        column = file.read(columns=[name], use_threads=False).column(0)
        kind = column.type.value_type if pa.types.is_dictionary(column.type) else column.type
        if not _is_number(kind):
            raise _not_numbers(name, str(column.type))
        values = column.cast(kind).cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
        columns.append((name, np.asarray(values, dtype=np.float64)))
    return _table(columns, names)


def _is_number(kind: Any) -> bool:
    from pyarrow import types

    return any(
        test(kind) for test in (types.is_integer, types.is_floating, types.is_decimal, types.is_boolean)
    )


def _mat(request: dict[str, Any], budget: Budget) -> Answer:
    """The columns asked for of a MATLAB file up to v7; the names of all. v7.3 is HDF5, which the parent asks for."""
    from scipy.io import loadmat, whosmat

    try:
        kinds = {name: (shape, kind) for name, shape, kind in whosmat(request["path"])}
    except NotImplementedError:
        return {"is_hdf5": True}, []
    held = {name: shape for name, (shape, _) in kinds.items()}
    structs = [name for name, (_, kind) in kinds.items() if kind == "struct"]  # whose fields are to be named
    requested = dict.fromkeys(name.split(".")[0] for name in request["names"]) if request["names"] else structs
    variables = [name for name in requested if name in held]
    for name in variables:
        budget.take(8 * math.prod(int(n) for n in held[name]), f"dataset '{name}'")
    loaded = loadmat(request["path"], simplify_cells=True, variable_names=variables) if variables else {}
    flat = dict(_flat({name: loaded[name] for name in variables}, "", 0))
    columns = []
    for name in request["names"]:
        if name in flat:
            columns.append((name, _numbers(flat[name], name)))
            budget.take(columns[-1][1].nbytes, f"dataset '{name}'")
    return _table(columns, [*flat, *(name for name in held if name not in variables)])


def _flat(content: dict[str, Any], prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Nested structs as one list, with dotted names."""
    for name, value in content.items():
        if isinstance(value, dict) and depth < DEEPEST:
            yield from _flat(value, f"{prefix}{name}.", depth + 1)
        else:
            yield prefix + name, value


def _numbers(value: Any, name: str) -> Any:
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise _not_numbers(name, type(value).__name__) from None


def _not_numbers(name: str, kind: str) -> Refused:
    return Refused(
        f"dataset '{name}'",
        f"what is not numeric ({kind})",
        "numbers",
        "text, dates or a struct",
        "map a numeric column (struct.field in a mat file)",
    )


def _table(columns: list[tuple[str, Any]], names: list[str]) -> Answer:
    entries = [{"place": name, "shape": list(v.shape), "dtype": v.dtype.str} for name, v in columns]
    return {"datasets": entries, "names": names[:MOST_NAMES]}, [values for _, values in columns]


_READERS: dict[str, Callable[[dict[str, Any], Budget], Answer]] = {
    "hdf5": _hdf5,
    "parquet": _parquet,
    "mat": _mat,
}

if __name__ == "__main__":
    main()
