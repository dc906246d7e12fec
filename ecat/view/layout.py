"""The blueprint: which views of a session stand where when it is opened."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ecat.geometry.transforms import Floats, matrix_about_z
from ecat.view.plots import METRICS, QUALITY
from ecat.view.scene import CAMERA, IMAGE, WORLD, Scene, Timebase

if TYPE_CHECKING:
    from collections.abc import Sequence

    import rerun.blueprint as rrb

_TITLES = {
    "speed_m_per_s": "Speed, m/s",
    "residual_px": "Residual, px",
    "sigma_mm": "Sigma, mm",
    "n_faces": "Faces used",
}
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
) -> rrb.Blueprint:
    """Views for what the entity ``paths`` hold: image and space above, lanes and curves below.

    Parameters
    ----------
    paths : entity paths of everything sent.
    scene : whose clock decides the timeline.
    image_size : width and height of the colour image in pixels, None where unknown.
    overview : what to look at first in space; None lets Rerun choose.
    """
    import rerun.blueprint as rrb

    top = [view for view in (_image(paths, image_size), _space(paths, overview)) if view]
    bottom = {
        name: view
        for name, view in (
            ("lanes", _lanes(paths, scene.timebase)),
            ("curves", _curves(paths, scene.timebase)),
        )
        if view
    }
    shares = {"lanes": 10, "curves": 7, "texts": 5}
    below = rrb.Horizontal(
        *bottom.values(), _texts(paths), column_shares=[shares[n] for n in [*bottom, "texts"]]
    )
    return rrb.Blueprint(
        rrb.Vertical(rrb.Horizontal(*top), below, row_shares=[11, 10]) if top else below,
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


def _space(paths: Sequence[str], overview: Overview | None) -> rrb.View | None:
    import rerun.blueprint as rrb

    if not _any(
        paths, f"{WORLD}/boxes/", *(f"{CAMERA}/{part}" for part in ("depth", "markers", "skeleton", "shapes"))
    ):
        return None
    last = [
        rrb.VisibleTimeRange("session_time", start=_before(seconds=-PATH_S), end=_before(seconds=0)),
        rrb.VisibleTimeRange("frame", start=_before(seq=-round(30 * PATH_S)), end=_before(seq=0)),
    ]
    overrides: Any = {
        path: rrb.archetypes.VisibleTimeRanges(last) for path in paths if path.startswith(f"{WORLD}/paths/")
    }
    return rrb.Spatial3DView(
        origin=WORLD,
        name="Table",
        contents=["$origin/**", f"- {IMAGE}/**", f"+ {IMAGE}", f"+ {IMAGE}/image"],
        background=_DARK,
        line_grid=rrb.LineGrid3D(spacing=0.1, stroke_width=0.6, color=(120, 130, 145, 70)),
        eye_controls=_eye(overview) if overview is not None else None,
        overrides=overrides,
    )


def _eye(overview: Overview) -> rrb.EyeControls3D:
    """Where the scene is first seen from: to one side of the camera, with it and the whole table in sight."""
    import rerun.blueprint as rrb

    low, high = overview.table.min(0), overview.table.max(0)
    target = np.append((low + high) / 2, 0.05)
    side = matrix_about_z(np.array(np.radians(35.0))) @ np.append((overview.camera_at - target)[:2], 0.0)
    side = side / max(float(np.linalg.norm(side)), 1e-6)
    reach = 1.05 * float(np.linalg.norm(high - low)) + 0.2
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + reach * (np.cos(_EYE_RAD) * side + [0.0, 0.0, np.sin(_EYE_RAD)]),
        look_target=target,
        eye_up=(0.0, 0.0, 1.0),
    )


def _before(**offset: Any) -> Any:
    import rerun.blueprint as rrb

    return rrb.TimeRangeBoundary.cursor_relative(**offset)


def _lanes(paths: Sequence[str], timebase: Timebase) -> rrb.View | None:
    import rerun.blueprint as rrb

    if not _any(paths, "/events/", "/relations/", "/support/"):
        return None
    contents = ["/events/**", "/relations/**", "/support/**"]
    return rrb.StateTimelineView(
        origin="/",
        contents=contents,
        name="Events, relations, support",
        time_view=_whole(timebase),
    )


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
    halves = [views[::2], views[1::2]]
    return rrb.Vertical(*(rrb.Tabs(*half) for half in halves if half)) if views else None


def _texts(paths: Sequence[str]) -> rrb.Container:
    import rerun.blueprint as rrb

    about = rrb.TextDocumentView(origin="/about", name="About")
    return rrb.Tabs(about, *([rrb.TextLogView(origin="/log", name="Log")] if _any(paths, "/log/") else []))
