"""Files that a page sends, kept outside of the project until something is made of them."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shutil
import time
from collections.abc import AsyncIterable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ecat.errors import LimitError, NotFoundError, UsageError
from ecat.store import files
from ecat.web.proxies import cache_folder

MOST_FILES = 10_000
MOST_PARTS = 8
USUAL_GB = 50.0
"""``ECAT_UPLOAD_GB`` sets another limit for one upload."""
LEAST_FREE_BYTES = 256 << 20
_STALE_S = 24 * 3600
_PART = re.compile(r"[^/\\\x00-\x1f\x7f]{1,200}")


@dataclass
class _Held:
    """How much of an upload has come."""

    files: int = 0
    bytes: int = 0


class Uploads:
    """Folders that fill, below the cache folder; what was left behind for a day goes."""

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = folder or cache_folder().with_name("uploads")
        self._held: dict[str, _Held] = {}

    def begin(self) -> str:
        """The id of a new, empty upload."""
        self._tidy()
        name = secrets.token_hex(16)
        with files.typed_errors("cannot take files", self.folder):
            files.make_folders(self.folder / name)
        self._held[name] = _Held()
        return name

    async def put(self, name: str, path: str, pieces: AsyncIterable[bytes]) -> int:
        """Write a file of an upload as it comes; its size.

        Raises
        ------
        NotFoundError : there is no such upload.
        UsageError : ``path`` leads elsewhere, or is there already.
        LimitError : it is too much.
        """
        target, held = self._place(name, path), self._held[name]
        held.files += 1
        if held.files > MOST_FILES:
            raise _too_much(f"more than {MOST_FILES:,} files")
        most = float(os.environ.get("ECAT_UPLOAD_GB", USUAL_GB)) * 1e9
        size = 0
        with files.typed_errors(f"cannot take {target.name}", target):
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                with target.open("xb") as file:
                    async for piece in pieces:
                        size += len(piece)
                        held.bytes += len(piece)
                        self._require_room(held.bytes, most)
                        file.write(piece)
            except FileExistsError:
                raise UsageError(
                    f"cannot take {target.name}", where=f"{path}: sent twice", fix="send it once"
                ) from None
            except BaseException:
                held.bytes -= size
                target.unlink(missing_ok=True)
                raise
        return size

    def discard(self, name: str) -> None:
        """Forget an upload and its files."""
        if self._held.pop(name, None) is not None:
            with contextlib.suppress(OSError):
                shutil.rmtree(self.folder / name)

    @contextmanager
    def taken(self, name: str) -> Generator[Path]:
        """What was sent, for as long as the block runs: the one file or folder, or the folder of all.

        Raises
        ------
        NotFoundError : there is no such upload, or nothing in it.
        """
        folder = self._known(name)
        try:
            inside = sorted(folder.iterdir())
            if not inside:
                raise NotFoundError("cannot read what was sent", where="nothing was sent", fix="choose files")
            yield inside[0] if len(inside) == 1 else folder
        finally:
            self.discard(name)

    def close(self) -> None:
        """Forget all of them."""
        for name in list(self._held):
            self.discard(name)

    def _require_room(self, size: int, most: float) -> None:
        if size > most:
            raise _too_much(f"more than {most / 1e9:g} GB (ECAT_UPLOAD_GB)")
        if shutil.disk_usage(self.folder).free < LEAST_FREE_BYTES:
            raise _too_much("the disk is full")

    def _known(self, name: str) -> Path:
        if name not in self._held:
            raise NotFoundError(
                "cannot find the upload", where=f"{name[:80]}: not of this server", fix="upload it again"
            )
        return self.folder / name

    def _place(self, name: str, path: str) -> Path:
        folder, parts = self._known(name), PurePosixPath(path).parts
        plain = all(_PART.fullmatch(part) and not part.startswith(".") for part in parts)
        if not parts or len(parts) > MOST_PARTS or not plain:
            raise UsageError(
                "cannot take the file",
                where=f"{path[:200]!r} is no path below a folder",
                fix="send it by its name, or by its path below the folder that was chosen",
            )
        return folder.joinpath(*parts)

    def _tidy(self) -> None:
        with contextlib.suppress(OSError):
            for left in self.folder.iterdir():
                if left.name not in self._held and time.time() - left.stat().st_mtime > _STALE_S:
                    shutil.rmtree(left, ignore_errors=True)


def _too_much(where: str) -> LimitError:
    return LimitError(
        "cannot take the files",
        where=where,
        consequence="nothing was imported",
        fix="use ecat import on the machine",
    )
