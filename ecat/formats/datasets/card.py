"""The page that comes with a data set, for people and for Hugging Face ``datasets``."""

from __future__ import annotations

import json
from collections.abc import Mapping

from ecat.tables import TABLES

CARD = "README.md"

_MEANINGS = {
    "moments": "a row for each moment of each episode, on a regular clock",
    "windows": "stretches of moments of equal length; `first_moment` and `moments` say which of `moments`",
}
_TEXT = """
# {title}

{sessions} recorded with RGB-D cameras: people handling objects, with what they did marked by people or proposed by a
machine.

| file | rows | what it is |
|---|---:|---|
{files}

Lengths are metres, angles radians, times nanoseconds since a session's start, axes right-handed with z up in the frame
`table`, quaternions `x, y, z, w`. What is not known is null. Every column says its unit and meaning in its metadata.

```python
import pandas as pd

moments = pd.read_parquet("moments.parquet")
windows = pd.read_parquet("windows.parquet")
w = windows.iloc[0]
rows = moments.query("session == @w.session and episode == @w.episode").iloc[w.first_moment:][:w.moments]
```

With Hugging Face: `datasets.load_dataset("parquet", data_files="moments.parquet")`, or `load_dataset(FOLDER,
"windows")`.

## How the clock was made

Recordings are irregular. Moments are {fps} a second; numbers at each were taken by the method `{method}`, and are null
where nothing was known within {gap_s} s.

## Options

```json
{options}
```
"""


def card(
    rows: Mapping[str, int], n_sessions: int, clock: Mapping[str, object], options: Mapping[str, object]
) -> str:
    """The page: YAML that names each file as a configuration, and a text.

    Parameters
    ----------
    rows : of each file, by its path in the data set.
    """
    head = ["---", "task_categories:", "- robotics", "configs:"]
    for name in rows:
        head += [f"- config_name: {_stem(name)}", f"  data_files: {name}"]
        head += ["  default: true"] * (name == next(iter(rows)))
    lines = [f"| `{name}` | {n:,} | {_meaning(_stem(name))} |" for name, n in rows.items()]
    text = _TEXT.format(
        title="Recordings of people handling objects",
        sessions="1 session" if n_sessions == 1 else f"{n_sessions:,} sessions",
        files="\n".join(lines),
        fps=clock["fps"],
        method=clock["method"],
        gap_s=clock["gap_s"],
        options=json.dumps(options, indent=1),
    )
    return "\n".join([*head, "---", text])


def _meaning(name: str) -> str:
    return _MEANINGS.get(name) or TABLES[name].meaning.rstrip(".")


def _stem(name: str) -> str:
    return name.rpartition("/")[2].removesuffix(".parquet")
