"""The directory of a sweep: ``sweep.json``, ``inputs.json`` and the append-only ``episodes.jsonl``, packed or not."""

from __future__ import annotations

import errno
import fcntl
import gzip
import json
import os
import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, NoReturn

from benchmark.config import SweepConfig, as_fields
from benchmark.records.episode_record import SCHEMA, EpisodeRecord, from_json, parse_object, to_json
from benchmark.strict_json import decode
from vision.errors import FileFormatError, InputError, ResourceError
from vision.files.regular import check_regular

SWEEP_FILE = "sweep.json"
EPISODES_FILE = "episodes.jsonl"
PACKED_FILE = "episodes.jsonl.gz"
INPUTS_FILE = "inputs.json"


@dataclass(frozen=True)
class _Inputs:
    """What ``inputs.json`` holds."""

    sha256: dict[str, str]


class RecordWriter:
    """Appends records to a sweep's directory; each is on the disk when ``append`` returns.

    Only one writer at a time: a second one is refused, for as long as the first one's process lives.
    """

    def __init__(self, directory: Path, config: SweepConfig) -> None:
        """Open or create the directory, and cut off a line that an earlier run left torn.

        Args:
            directory: of the sweep.
            config: of the sweep; must be the one that the directory was made for, if there is one.

        Raises:
            InputError: unwritable, made for another configuration, or in use.
            ResourceError: no space.
        """
        _check_place(directory)
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._file: BinaryIO = open(directory / EPISODES_FILE, "ab")  # noqa: SIM115
        except OSError as error:
            _raise(error, directory)
        try:
            self._lock(directory)
            self._guard(directory, lambda: self._prepare(directory, config))
        except BaseException:
            self._file.close()
            raise
        self._directory = directory

    def _lock(self, directory: Path) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                got = f"a file system without locks ({error.strerror})"
                do = "Choose an --out on another file system, such as a local disk."
                raise InputError(f"output {directory}", got=got, expected="one with locks", do=do) from None
            do = "Wait for it, stop it, or choose another --out."
            raise InputError(f"sweep in {directory}", got="one that is running", expected="none", do=do) from None

    def _prepare(self, directory: Path, config: SweepConfig) -> None:
        if (directory / SWEEP_FILE).exists():
            found = read_config(directory)
            if found.config_hash != config.config_hash:
                do = "Choose another --out, or repeat the options of the sweep that is there."
                differences = _differences(found, config)
                raise InputError(f"sweep in {directory}", got=differences[0], expected=differences[1], do=do)
        else:
            _write_whole(directory / SWEEP_FILE, as_fields(config))
        content = (directory / EPISODES_FILE).read_bytes()
        self._file.truncate(content.rfind(b"\n") + 1)

    def keep_inputs(self, digests: dict[str, str], begun: bool) -> None:
        """Note the content of the files that the results depend on; hold it to what an earlier run has noted.

        A directory of a version that noted nothing is left as it is.

        Args:
            digests: SHA-256 of every such file, by a name that a person understands.
            begun: results are there that came from what was noted.

        Raises:
            InputError: a file has changed since.
            FileFormatError: the note is corrupt.
            ResourceError: no space.
        """
        path = self._directory / INPUTS_FILE
        noted = read_inputs(self._directory) if path.exists() else {}
        if not begun:
            self._guard(self._directory, lambda: _write_whole(path, {"sha256": digests}))
        elif changed := {name: digest for name, digest in noted.items() if digests.get(name) != digest}:
            got, expected = (
                ", ".join(f"{name} {_short(known.get(name))}" for name in changed) for known in (digests, changed)
            )
            do = "Put the file back, or choose another --out for a new sweep; this one began with it."
            raise InputError(f"sweep in {self._directory}", got=got, expected=expected, do=do)

    def append(self, record: EpisodeRecord) -> None:
        """Write one record; it survives a crash of the process and of the machine.

        Raises:
            ResourceError: the disk is full or gone; what was recorded before stays good.
        """
        self._guard(self._directory, lambda: self._write(to_json(record).encode() + b"\n"))

    def _write(self, line: bytes) -> None:
        self._file.write(line)
        self._file.flush()
        os.fsync(self._file.fileno())

    @staticmethod
    def _guard(directory: Path, action: Callable[[], None]) -> None:
        try:
            action()
        except OSError as error:
            _raise(error, directory)

    def close(self) -> None:
        """Close the file and let the next writer in."""
        try:
            self._file.close()
        except OSError as error:  # a full disk shows again when the buffer is flushed for the last time
            _raise(error, self._directory)

    def __enter__(self) -> RecordWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            self.close()
        except ResourceError:
            if error is None:
                raise


def read_config(directory: Path) -> SweepConfig:
    """The configuration of the sweep in a directory.

    Raises:
        InputError: no sweep there.
        FileFormatError: corrupt.
    """
    path = directory / SWEEP_FILE
    text = _read(path)
    return decode(SweepConfig, parse_object(text, str(path)), str(path))


def read_inputs(directory: Path) -> dict[str, str]:
    """SHA-256 of the files that the results in a directory depend on, by their names.

    Raises:
        InputError: there is no such note.
        FileFormatError: corrupt.
    """
    path = directory / INPUTS_FILE
    return decode(_Inputs, parse_object(_read(path), str(path)), str(path)).sha256


def read_records(directory: Path) -> list[EpisodeRecord]:
    """The records of a sweep, sorted by key, one per episode; a torn last line is passed over.

    Of an episode that failed and was tried again, the later record counts.

    Raises:
        InputError: no sweep there.
        FileFormatError: a line other than a torn last one cannot be read; names line and field.
    """
    path, packed = directory / EPISODES_FILE, directory / PACKED_FILE
    text = _unpacked(packed) if packed.is_file() and not path.exists() else _read(path)
    whole, _, _torn = text.rpartition("\n")
    records: dict[str, EpisodeRecord] = {}
    for number, line in enumerate(whole.split("\n") if whole else [], start=1):
        if line.strip():
            record = from_json(line, f"{path} line {number}")
            earlier = records.get(record.key)
            if earlier is None or earlier.error is not None:
                records[record.key] = record
    return [records[key] for key in sorted(records)]


def pack_records(directory: Path, target: Path) -> None:
    """Keep a finished sweep's configuration and its records in another directory, in about a fifth of their size.

    Raises:
        InputError: a directory cannot be read or written.
    """
    lines = "".join(f"{to_json(record)}\n" for record in read_records(directory))
    try:
        target.mkdir(parents=True, exist_ok=True)
        (target / SWEEP_FILE).write_text(_read(directory / SWEEP_FILE), encoding="utf-8")
        (target / PACKED_FILE).write_bytes(gzip.compress(lines.encode(), 9, mtime=0))
    except OSError as error:
        _raise(error, target)


def _unpacked(path: Path) -> str:
    try:
        return gzip.decompress(path.read_bytes()).decode()
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise FileFormatError(str(path), got=str(error), expected="compressed records") from None


def _check_place(directory: Path) -> None:
    """Refuse what would block for ever or litter: a pipe in the records' place, the working directory itself."""
    check_regular(directory / EPISODES_FILE)
    if directory.resolve() == Path.cwd() and not (directory / SWEEP_FILE).exists():
        do = "Name a directory, such as --out results/mine."
        raise InputError("output", got=f"the working directory, {directory}", expected="one of its own", do=do)


def _read(path: Path) -> str:
    check_regular(path)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(str(path), got=f"a byte that is not UTF-8 at {error.start}", expected="text") from None
    except OSError as error:
        do = "Give the directory that `focalpick sweep --out` wrote."
        raise InputError(str(path), got=error.strerror, expected="a file that can be read", do=do) from None


def _write_whole(path: Path, fields: dict[str, Any]) -> None:
    """Write a JSON file whole or not at all."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    with open(temporary, "w", encoding="utf-8") as file:
        json.dump({"schema": SCHEMA, **fields}, file, indent=2)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)


def _differences(found: SweepConfig, wanted: SweepConfig) -> tuple[str, str]:
    """The options in which two configurations differ, as text, for each of them."""
    a, b = ({**asdict(config), "variants": [v.name for v in config.variants]} for config in (found, wanted))
    names = [name for name in a if a[name] != b[name] and name != "workers"]
    texts = [", ".join(f"{name}={_text(fields[name])}" for name in names) for fields in (a, b)]
    return texts[0], texts[1]


def _short(digest: str | None) -> str:
    return "without a file" if digest is None else f"with SHA-256 {digest[:12]}"


def _text(value: object) -> str:
    return ",".join(map(str, value)) if isinstance(value, (tuple, list)) else str(value)


def _raise(error: OSError, directory: Path) -> NoReturn:
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO):
        raise ResourceError(
            f"cannot write to {directory}: {error.strerror}; make room and run the same command again, "
            "what is recorded stays"
        ) from None
    do = "Choose another --out or change its permissions."
    raise InputError(f"output {directory}", got=error.strerror, expected="a writable directory", do=do) from None
