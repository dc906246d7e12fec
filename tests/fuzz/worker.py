"""Fuzz targets, guided by coverage, each until its time is up.

Started as ``python -m tests.fuzz.worker``; every line that is read, ``TARGET SECONDS FOLDER``, fuzzes one target in a
process that is forked for it, and is answered by a line with that process' exit code.  To instrument all readers takes
ten times as long as a short search, and is done once.  Findings are cut down and left as files in FOLDER, their stories
beside them; libFuzzer leaves its own there when the process itself dies (crash, out of memory, no end), and ``log`` is
what it says.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import re
import sys
from pathlib import Path

MAX_INPUT_BYTES = 1 << 16
MAX_RSS_MIB = 1500


def main() -> None:
    """Fuzz what standard input asks for."""
    import atheris

    with atheris.instrument_imports(include=["ecat"]):  # pyright: ignore[reportAttributeAccessIssue]
        from tests.fuzz import harness
        from tests.fuzz.targets import TARGETS

        assert harness
        for target in TARGETS.values():
            assert target.run, "loads its reader"
    for line in sys.stdin:
        name, seconds, folder = line.rstrip("\n").split(" ", 2)
        child = os.fork()
        if not child:
            # what is to be done at the end is done by the process that waits
            getattr(atexit, "_clear")()  # noqa: B009  has no public name
            log = os.open(Path(folder, "log"), os.O_CREAT | os.O_WRONLY, 0o600)
            os.dup2(log, 1)
            os.dup2(log, 2)
            _fuzz(name, float(seconds), Path(folder))
            os._exit(0)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


def _fuzz(name: str, seconds: float, folder: Path) -> None:
    """Fuzz; does not return, since libFuzzer ends the process."""
    import atheris

    from tests.fuzz.harness import check, minimise
    from tests.fuzz.targets import TARGETS

    target = TARGETS[name]
    corpus, dictionary = folder / "corpus", folder / "dictionary"
    corpus.mkdir(parents=True)
    for i, seed in enumerate(target.seeds):
        (corpus / f"seed{i}").write_bytes(seed)
    dictionary.write_text(_dictionary(target.seeds))
    seen: set[str] = set()

    def one_input(data: bytes) -> None:
        finding = check(name, data)
        if finding is not None and finding.key not in seen:
            seen.add(finding.key)
            case = minimise(name, data, finding)
            path = folder / f"finding-{hashlib.sha256(case).hexdigest()[:16]}"
            path.write_bytes(case)
            path.with_suffix(".txt").write_text(f"{finding.key}\n{finding.told}")

    atheris.Setup(
        [
            sys.argv[0],
            str(corpus),
            f"-max_total_time={max(1, round(seconds))}",
            f"-max_len={MAX_INPUT_BYTES}",
            f"-rss_limit_mb={MAX_RSS_MIB}",
            "-timeout=20",
            f"-dict={dictionary}",
            f"-artifact_prefix={folder}/",
            "-verbosity=1",
        ],
        one_input,
    )
    atheris.Fuzz()


def _dictionary(seeds: tuple[bytes, ...]) -> str:
    """The words of the seeds, and what XML is made of, in libFuzzer's notation."""
    words = {word for seed in seeds for word in re.findall(rb"</?[\w:]+|[\w:.]+=|[A-Za-z_]{2,}", seed)}
    words |= {
        b"<!--",
        b"-->",
        b"<![CDATA[",
        b"]]>",
        b"<?x?>",
        b"&#x0;",
        b"&lt;",
        b"<!DOCTYPE",
        b"\xef\xbb\xbf",
    }
    words |= {"∞".encode(), b"NaN", b"1e999", b"-1", b"99999999999999999999", b'xmlns="x"', b'xmlns:a="b"'}
    escaped = ("".join(f"\\x{byte:02x}" for byte in word) for word in sorted(words))
    return "".join(f'"{word}"\n' for word in escaped)


if __name__ == "__main__":
    main()
