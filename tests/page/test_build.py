"""The page that is served is the one whose sources are here, small, and alone in the world."""

from __future__ import annotations

import gzip
import hashlib
import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
STATIC = ROOT / "ecat" / "web" / "static"
WEB = ROOT / "web"
MOST_BYTES = 300_000
NAMESPACE = re.compile(rb"https?://www\.w3\.org/[\w/]+")


def test_it_was_built_from_these_sources() -> None:
    if not WEB.is_dir():
        pytest.skip("the sources of the page are not in this distribution")
    paths = [path for path in (WEB / "src").rglob("*") if path.is_file()]
    paths += [WEB / name for name in ("package-lock.json", "tsconfig.json", "vite.config.js")]
    digest = hashlib.sha256()
    for name, path in sorted((path.relative_to(WEB).as_posix(), path) for path in paths):
        digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    record = json.loads((STATIC / "build.json").read_text(encoding="utf-8"))
    assert record["sources_sha256"] == digest.hexdigest(), "npm run build in web, and commit what it wrote"


def test_every_file_that_it_names_is_there() -> None:
    named = re.findall(r'(?:src|href)="\./([^"]+)"', (STATIC / "index.html").read_text(encoding="utf-8"))
    assert named
    assert [name for name in named if not (STATIC / name).is_file()] == []


def test_it_weighs_less_than_300_kilobytes_compressed() -> None:
    sizes = {
        path.name: len(gzip.compress(path.read_bytes(), 9)) for path in STATIC.rglob("*") if path.is_file()
    }
    assert sum(sizes.values()) < MOST_BYTES, sizes


def test_it_asks_nobody_else_for_anything_and_has_no_script_inline() -> None:
    for path in STATIC.rglob("*"):
        if path.suffix in {".js", ".css", ".html", ".svg"}:
            found = set(re.findall(rb"https?://[^\s\"'`)]+", NAMESPACE.sub(b"", path.read_bytes())))
            assert not found, (path.name, found)
    page = (STATIC / "index.html").read_text(encoding="utf-8")
    assert not re.search(r"<script(?![^>]*\bsrc=)|<style|\sstyle=|\son\w+=", page)


def test_lock_file_names_no_machine() -> None:
    if not WEB.is_dir():
        pytest.skip("the sources of the page are not in this distribution")
    lock = (WEB / "package-lock.json").read_text(encoding="utf-8")
    assert set(re.findall(r'"resolved": "(https?://[^/"]+)', lock)) <= {"https://registry.npmjs.org"}
