"""Where the parts of an export wait to be joined: in a folder beside the destination, on this disk or elsewhere.

A part is there or not, never half.  It says what it was made from.

On this disk nothing is waited for: what is joined is made durable as a whole, and a part that another run takes as it
is shows by its hash that it did not suffer when the power failed.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ecat.errors import FormatError
from ecat.store import files, remote

_ABOUT = "part.json"
_DATA = "data"
Findings = tuple[str, ...]
Write = Callable[[Path], Findings]
"""Makes the part at a path and returns findings."""


def parts_of(dest: Path | str) -> LocalParts | RemoteParts:
    """Those of the export that is to be at ``dest``."""
    if isinstance(dest, str):
        return RemoteParts(f"{dest}.parts")
    place = dest.resolve()
    return LocalParts(place.with_name(f".{place.name}.parts"))


def _name(label: str) -> str:
    return hashlib.sha256(label.encode()).hexdigest()[:20]


@dataclass(frozen=True, slots=True)
class _About:
    """What a part says of itself: what it was made from, what was found then, and its hash (empty: not hashed)."""

    key: str
    findings: Findings
    sha256: str = ""

    def to_json(self) -> bytes:
        return json.dumps(asdict(self)).encode()

    @classmethod
    def wanted(cls, about: bytes | None, key: str) -> _About | None:
        """What a part says, if it is the one wanted."""
        try:
            said: Any = json.loads(about or b"")
        except ValueError:
            return None
        if not isinstance(said, dict) or said.get("key") != key:
            return None
        return cls(key, tuple(map(str, said.get("findings", ()))), str(said.get("sha256", "")))


def _sha256(part: Path) -> str:
    """Of a file; of a folder, of the names and contents of all files in it."""
    if not part.is_dir():
        return files.sha256_of(part)
    inside = sorted(path for path in part.rglob("*") if path.is_file())
    listed = [[path.relative_to(part).as_posix(), files.sha256_of(path)] for path in inside]
    return hashlib.sha256(json.dumps(listed).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class LocalParts:
    """In a folder of this machine, or of a disk that several share."""

    folder: Path

    def __str__(self) -> str:
        return str(self.folder)

    def known(self, label: str, key: str) -> Findings | None:
        """The findings of the part called ``label``, if it is there and was made from ``key``."""
        data, about = self._places(label)
        try:
            said = _About.wanted(about.read_bytes(), key)
            return None if said is None or _sha256(data) != said.sha256 else said.findings
        except (OSError, FormatError):
            return None

    def put(self, label: str, key: str, write: Write) -> Findings:
        """Make a part; it is there when this returns, and not at all if it raises."""
        data, about = self._places(label)
        staging = data.with_name(f"{data.name}.{secrets.token_hex(8)}.partial")
        with files.typed_errors(f"cannot write {label}", data, "this session is not in the export"):
            files.make_folders(self.folder)
            try:
                findings = write(staging)
                said = _About(key, findings, _sha256(staging))
                files.remove(about)
                files.remove(data)
                files.rename(staging, data)
                # it is a part from here on; if this is lost, or not whole, the part is made again
                with files.NewFile(about) as file:
                    file.write(said.to_json())
            except BaseException:
                files.remove(staging)
                raise
        return findings

    def _places(self, label: str) -> tuple[Path, Path]:
        data = self.folder / _name(label)
        return data, data.with_name(f"{data.name}.json")

    @contextmanager
    def data(self) -> Generator[Callable[[str], Path]]:
        """Where the part of a label is, for the time of the block."""
        yield lambda label: self._places(label)[0]

    def remove(self) -> None:
        """Remove all of them."""
        files.remove(self.folder)


@dataclass(frozen=True, slots=True)
class RemoteParts:
    """At a URL."""

    url: str

    def __str__(self) -> str:
        return self.url

    def known(self, label: str, key: str) -> Findings | None:
        """As of :class:`LocalParts`."""
        said = _About.wanted(remote.read(f"{self.url}/{_name(label)}/{_ABOUT}"), key)
        return None if said is None else said.findings

    def put(self, label: str, key: str, write: Write) -> Findings:
        """As of :class:`LocalParts`."""
        url = f"{self.url}/{_name(label)}"
        remote.remove(url)
        with TemporaryDirectory(prefix="ecat-") as scratch:
            folder = Path(scratch)
            findings = write(folder / _DATA)
            (folder / _ABOUT).write_bytes(_About(key, findings).to_json())
            # the file that makes it a part is the last to be there
            remote.send(folder / _DATA, f"{url}/{_DATA}")
            remote.send(folder / _ABOUT, f"{url}/{_ABOUT}")
        return findings

    @contextmanager
    def data(self) -> Generator[Callable[[str], Path]]:
        """Where a copy of the part of a label is, for the time of the block."""
        with TemporaryDirectory(prefix="ecat-") as scratch:

            def fetched(label: str) -> Path:
                path = Path(scratch) / _name(label)
                if not path.exists():
                    remote.fetch(f"{self.url}/{_name(label)}/{_DATA}", path)
                return path

            yield fetched

    def remove(self) -> None:
        """As of :class:`LocalParts`."""
        remote.remove(self.url)
