"""The blueprint: which views of a session stand where when it is opened."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ecat.geometry.transforms import Floats, matrix_about_z
from ecat.view.lanes import PROPOSED
from ecat.view.plots import IMU, METRICS, QUALITY
from ecat.view.scene import CAMERA, IMAGE, WORLD, Scene, Timebase
from ecat.view.streams import ShownStream

if TYPE_CHECKING:
    from collections.abc import Sequence

    import rerun.blueprint as rrb

_TITLES = {
    "speed_m_per_s": "Speed, m/s",
    "residual_px": "Residual, px",
    "sigma_mm": "Sigma, mm",
    "n_faces": "Faces used",
}
_SENSORS = {"accelerometer": "Acceleration, m/s²", "gyroscope": "Turning, rad/s"}
_LANES_AT_ONCE = 9
"""How many lanes the view has room for without scrolling."""
_DARK = (18, 21, 26)
_EYE_RAD = np.radians(32.0)
PATH_S = 2.0
"""How long the path behind a box stays."""


@dataclass(frozen=True)
class Overview:
    """The table's edge (n, 2) and where the depth camera stands (3,), both in the world, metres."""

    table: Floats
    camera_at: Floats


def layout(
    paths: Sequence[str],
    scene: Scene,
    *,
    image_size: tuple[int, int] | None,
    overview: Overview | None,
    streams: Sequence[ShownStream] = (),
) -> rrb.Blueprint:
    """Views for what the entity ``paths`` hold: image and space above, lanes and curves below.

    Parameters
    ----------
    paths : entity paths of everything sent but images.
    scene : whose clock decides the timeline.
    image_size : width and height of the colour image in pixels, None where unknown.
    overview : what to look at first in space; None: what lies before the depth camera.
    streams : the streams whose images are sent.
    """
    import rerun.blueprint as rrb

    paths = [*paths, *(shown.image_path for shown in streams)]
    top = {
        name: view
        for name, view in (
            ("image", _image(paths, image_size)),
            ("space", _space(paths, overview, streams)),
            ("others", _others(streams)),
        )
        if view
    }
    bottom = {
        name: view
        for name, view in (
            ("lanes", _lanes(paths, scene.timebase)),
            ("curves", _curves(paths, scene.timebase)),
        )
        if view
    }
    shares = {"lanes": 10, "curves": 7, "texts": 5, "image": 10, "space": 10, "others": 5}
    below = rrb.Horizontal(
        *bottom.values(), _texts(paths), column_shares=[shares[n] for n in [*bottom, "texts"]]
    )
    # without lanes and curves there is only text to read: the images get the room
    rows = [11, 10] if bottom else [11, 4]
    above = rrb.Horizontal(*top.values(), column_shares=[shares[n] for n in top])
    return rrb.Blueprint(
        rrb.Vertical(above, below, row_shares=rows) if top else below,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline="frame" if scene.timebase.t_ns is None else "session_time",
            play_state="paused",
        ),
    )


def _any(paths: Sequence[str], *prefixes: str) -> bool:
    return any(path.startswith(prefixes) for path in paths)


def _image(paths: Sequence[str], size: tuple[int, int] | None) -> rrb.View | None:
    import rerun.blueprint as rrb

    if not _any(paths, f"{IMAGE}/"):
        return None
    bounds = None
    if size is not None:
        width, height = size
        bounds = rrb.VisualBounds2D(
            x_range=[-0.02 * width, 1.02 * width], y_range=[-0.02 * height, 1.02 * height]
        )
    contents = ["$origin/**", f"{WORLD}/boxes/**", f"- {WORLD}/boxes/*/axes"]
    return rrb.Spatial2DView(
        origin=IMAGE, contents=contents, name="Colour image", background=_DARK, visual_bounds=bounds
    )


def _others(streams: Sequence[ShownStream]) -> rrb.Container | None:
    """Depth, infrared and further cameras, beside the annotated video: two below one another, more as tabs."""
    import rerun.blueprint as rrb

    views = [
        rrb.Spatial2DView(
            origin=shown.path, contents=["$origin/**"], name=_title(shown.stream.name), background=_DARK
        )
        for shown in streams
        if shown.path != IMAGE
    ]
    halves = [views[::2], views[1::2]]
    columns = [half[0] if len(half) == 1 else rrb.Tabs(*half) for half in halves if half]
    return rrb.Vertical(*columns) if columns else None


def _title(name: str) -> str:
    return name[:1].upper() + name[1:]


def _space(
    paths: Sequence[str], overview: Overview | None, streams: Sequence[ShownStream]
) -> rrb.View | None:
    import rerun.blueprint as rrb

    in_space = [s.path for s in streams if s.stream.kind == "depth" and s.camera is not None]
    measured = ("markers", "skeleton", "shapes", "hulls", "table_outline")
    drawn = (f"{WORLD}/boxes/", f"{WORLD}/camera_path", *(f"{CAMERA}/{part}" for part in measured))
    if not in_space and not _any(paths, *drawn):
        return None
    last = [
        rrb.VisibleTimeRange("session_time", start=_before(seconds=-PATH_S), end=_before(seconds=0)),
        rrb.VisibleTimeRange("frame", start=_before(seq=-round(30 * PATH_S)), end=_before(seq=0)),
    ]
    overrides: Any = {
        path: rrb.archetypes.VisibleTimeRanges(last) for path in paths if path.startswith(f"{WORLD}/paths/")
    }
    pixels = [
        s.image_path for s in streams if s.path not in in_space and (s.path != IMAGE or s.camera is None)
    ]
    return rrb.Spatial3DView(
        origin=WORLD,
        name="Space" if overview is None else "Table",
        contents=[
            "$origin/**",
            f"- {IMAGE}/**",
            f"+ {IMAGE}",
            f"+ {IMAGE}/image",
            *(f"- {path}" for path in pixels),
        ],
        background=_DARK,
        line_grid=rrb.LineGrid3D(
            visible=overview is not None, spacing=0.1, stroke_width=0.6, color=(120, 130, 145, 70)
        ),
        eye_controls=_eye(overview) if overview is not None else _eye_behind_camera(),
        overrides=overrides,
    )


def _eye_behind_camera() -> rrb.EyeControls3D:
    """Over the depth camera's shoulder; it stands upright in the world's origin and looks along y."""
    import rerun.blueprint as rrb

    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=(0.7, -0.9, 0.6),
        look_target=(0.0, 1.5, -0.1),
        eye_up=(0.0, 0.0, 1.0),
    )


def _eye(overview: Overview) -> rrb.EyeControls3D:
    """Where the scene is first seen from: to one side of the camera, with it and the whole table in sight."""
    import rerun.blueprint as rrb

    low, high = overview.table.min(0), overview.table.max(0)
    target = np.append((low + high) / 2, 0.05)
    side = matrix_about_z(np.array(np.radians(35.0))) @ np.append((overview.camera_at - target)[:2], 0.0)
    side = side / max(float(np.linalg.norm(side)), 1e-6)
    reach = 1.2 * float(np.linalg.norm(high - low)) + 0.2
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + reach * (np.cos(_EYE_RAD) * side + [0.0, 0.0, np.sin(_EYE_RAD)]),
        look_target=target,
        eye_up=(0.0, 0.0, 1.0),
    )


def _before(**offset: Any) -> Any:
    import rerun.blueprint as rrb

    return rrb.TimeRangeBoundary.cursor_relative(**offset)


def _lanes(paths: Sequence[str], timebase: Timebase) -> rrb.View | rrb.Container | None:
    """One view while all lanes can be seen at once, else tabs: relations and support apart."""
    import rerun.blueprint as rrb

    roots = {kind: [f"/{kind}", f"{PROPOSED}/{kind}"] for kind in ("events", "relations")}
    roots["support"] = ["/support"]
    there = {kind.capitalize(): mine for kind, mine in roots.items() if _any(paths, *(f"{r}/" for r in mine))}
    if not there:
        return None
    every = [root for mine in there.values() for root in mine]
    n_lanes = sum(path.startswith(tuple(f"{root}/" for root in every)) for path in paths)
    grouped = {"Events, relations, support": every} if n_lanes <= _LANES_AT_ONCE else there
    views = [
        rrb.StateTimelineView(
            origin="/", contents=[f"{root}/**" for root in mine], name=name, time_view=_whole(timebase)
        )
        for name, mine in grouped.items()
    ]
    return views[0] if len(views) == 1 else rrb.Tabs(*views)


def _whole(timebase: Timebase) -> rrb.archetypes.TimeAxis:
    """From the first to the last frame; left alone, a view may start with the first half minute."""
    import rerun as rr
    import rerun.blueprint as rrb

    end = timebase.n_frames if timebase.t_ns is None else int(timebase.t_ns[-1])
    ends = [rrb.TimeRangeBoundary.absolute(seq=at) for at in (0, max(end, 1))]
    return rrb.archetypes.TimeAxis(view_range=rr.TimeRange(start=ends[0], end=ends[1]))


def _curves(paths: Sequence[str], timebase: Timebase) -> rrb.Container | None:
    import rerun.blueprint as rrb

    views = [
        rrb.TimeSeriesView(
            origin=f"{QUALITY}/{metric}",
            axis_x=_whole(timebase),
            name=_TITLES[metric],
            plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
        )
        for metric in METRICS
        if _any(paths, f"{QUALITY}/{metric}/")
    ]
    for sensor, title in _SENSORS.items():
        if _any(paths, f"{IMU}/{sensor}/"):
            views.append(rrb.TimeSeriesView(origin=f"{IMU}/{sensor}", axis_x=_whole(timebase), name=title))
    halves = [views[::2], views[1::2]]
    return rrb.Vertical(*(rrb.Tabs(*half) for half in halves if half)) if views else None


def _texts(paths: Sequence[str]) -> rrb.Container:
    import rerun.blueprint as rrb

    about = rrb.TextDocumentView(origin="/about", name="About")
    return rrb.Tabs(about, *([rrb.TextLogView(origin="/log", name="Log")] if _any(paths, "/log/") else []))
