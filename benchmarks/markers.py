"""Markers against rendered truth: corners, recall, false finds, and what following them saves.

    python benchmarks/markers.py [--full] [--photos FOLDER ...] [--seed 23] [--figures following]

Corners and recall: markers drawn eight times as large (tests/geometry/printed.py).  Following: a session of
`ecat.sample.pixels`, encoded as H.264 and decoded again; "every frame" is an independent search of every image.  False
finds: real photographs (the reference data, if it lies beside the checkout, and the folders named) and images full of
text, squares and patterns; half each; 10,000 images with --full.  Times are of one thread, by the processor's clock;
following is timed in several turns, of which the least counts for each image.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from ecat.geometry.corners import clockwise, outline
from ecat.geometry.detection import Detector, Found
from ecat.geometry.markers import dictionary_code
from ecat.geometry.transforms import Floats
from ecat.model.prototype import FACES, NOMINAL_BOXES, BoxPrototype, nominal_face
from ecat.sample import ACTIONS, sample_session
from ecat.sample.pixels import Renderer
from ecat.stages.tracker import Tracker, TrackParameters
from tests.geometry.printed import Print, exposed, paint, random_ring, wall

Grey = NDArray[np.uint8]
CELL = 190
EVERY = TrackParameters().every
TURNS = 4


def line(what: str, reached: str, target: str = "") -> None:
    """Print a row of the table."""
    print(f"| {what} | {reached} | {target} |", flush=True)


def clocked(run: Callable[[], Any], times: int = 30) -> float:
    """Median milliseconds."""
    taken: list[float] = []
    for _ in range(times):
        started = time.thread_time()
        run()
        taken.append(1e3 * (time.thread_time() - started))
    return float(np.median(taken))


def own_boxes(dictionary: str, n: int = 3) -> tuple[BoxPrototype, ...]:
    """Cubes of 6 cm with six faces each."""
    size = (0.06, 0.06, 0.06)
    return tuple(
        BoxPrototype(
            f"{dictionary} {b}",
            size,
            tuple(
                nominal_face(f, dictionary_code(dictionary, 6 * b + i), 0.045, size)
                for i, f in enumerate(FACES)
            ),
        )
        for b in range(n)
    )


def scene(
    rng: np.random.Generator, boxes: Sequence[BoxPrototype], sides: tuple[float, float]
) -> tuple[Grey, dict[tuple[int, int], tuple[Floats, float]], float]:
    """A 1080p image with each face of the boxes once, somewhere, tilted up to 65 degrees; the truth; the blur."""
    image = wall(rng, (1080, 1920), rng.uniform(70, 150))
    keys = [(b, f) for b, box in enumerate(boxes) for f in range(len(box.faces))]
    slots = rng.permutation((1920 // CELL) * (1080 // CELL))[: len(keys)]
    truth: dict[tuple[int, int], tuple[Floats, float]] = {}
    for (b, f), slot in zip(keys, slots.tolist(), strict=True):
        row, column = divmod(slot, 1920 // CELL)
        side = rng.uniform(*sides)
        ring = random_ring(rng, side) + (np.array([column, row]) + 0.5) * CELL + rng.uniform(-9, 9, 2)
        paper = Print(rng.uniform(15, 50), rng.uniform(150, 235), rng.uniform(0.12, 0.3))
        paint(image, boxes[b].faces[f].code, ring, paper)
        truth[b, f] = ring, side
    blur = rng.uniform(0, 1)
    return exposed(image, rng, blur_px=blur, noise=rng.uniform(1, 4)), truth, blur


def corners(seed: int) -> None:
    """How far corners are off, with ours and with OpenCV's refinement."""
    rng = np.random.default_rng(seed)
    boxes = (*NOMINAL_BOXES, *own_boxes("DICT_5X5_50", 2))
    ours: list[Floats] = []
    theirs: list[Floats] = []
    rings, image = np.empty((0, 4, 2)), np.empty((0, 0), np.uint8)
    for _ in range(8):
        image, truth, _ = scene(rng, boxes, (25, 40))
        found = Detector(boxes).search(image)
        rings = np.stack([ring for ring, _ in truth.values()])
        for b, f, ring in zip(found.box.tolist(), found.face.tolist(), found.rings, strict=True):
            ours.append(ring - truth[b, f][0])
        rough = np.round(rings + rng.normal(0, 0.5, rings.shape)).astype(np.float32).reshape(-1, 1, 2)
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.1)
        theirs += list(cv2.cornerSubPix(image, rough, (3, 3), (-1, -1), stop).reshape(rings.shape) - rings)
    error, other = (np.sqrt((np.array(e) ** 2).sum(-1)) for e in (ours, theirs))
    line("corners, sides 25-40 px, RMSE", f"{np.sqrt((error**2).mean()):.3f} px", "<= 0.2 px")
    line("... median, 99 %", f"{np.median(error):.3f}, {np.percentile(error, 99):.3f} px")
    line("... cv2.cornerSubPix, RMSE", f"{np.sqrt((other**2).mean()):.3f} px")
    some = clockwise(rings[:14])
    taken = clocked(lambda: outline(image, outline(image, some, reach_px=3).rings, reach_px=2))
    line("... of 14 markers, iterated once", f"{taken:.2f} ms", "<= 2 ms")


def recall(seed: int) -> None:
    """Which faces are found, tilt up to 65 degrees, blur up to sigma 1."""
    boxes = (*NOMINAL_BOXES, *own_boxes("DICT_4X4_50", 3))
    detector = Detector(boxes)
    for sides, target in (((24.0, 40.0), ">= 99 %"), ((18.0, 24.0), ">= 85 %"), ((13.0, 18.0), "")):
        rng = np.random.default_rng(seed)
        found = total = opencv = wrong = 0
        for _ in range(12):
            image, truth, _ = scene(rng, boxes, sides)
            faces = detector.search(image)
            right = {
                key
                for key, ring in zip(
                    zip(faces.box.tolist(), faces.face.tolist(), strict=True), faces.rings, strict=True
                )
                if np.abs(ring - truth[key][0]).max() < 2
            }
            found, wrong, total = found + len(right), wrong + len(faces) - len(right), total + len(truth)
            opencv += opencv_finds(image, truth)
        what = f"faces found, sides {sides[0]:g}-{sides[1]:g} px ({total})"
        line(
            what,
            f"{100 * found / total:.2f} %, {wrong} in a wrong place (OpenCV {100 * opencv / total:.1f} %)",
            target,
        )


def opencv_finds(image: Grey, truth: dict[tuple[int, int], tuple[Floats, float]]) -> int:
    """How many of the faces OpenCV finds with its defaults."""
    n = 0
    for name in ("DICT_ARUCO_ORIGINAL", "DICT_4X4_50"):
        detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(int(getattr(cv2.aruco, name))))
        centres = [np.asarray(ring).reshape(4, 2).mean(0) for ring in detector.detectMarkers(image)[0]]
        places = np.stack([ring.mean(0) for ring, _ in truth.values()])
        n += sum(bool((np.linalg.norm(places - centre, axis=1) < 4).any()) for centre in centres)
    return n


# ---------------------------------------------------------------------------------------------- following


def session(path: Path, seed: int, n: int) -> tuple[Renderer, int]:
    """Encode the beginning of a rendered session as H.264."""
    import av

    _, truth = sample_session(seed=seed, actions=ACTIONS[:2])
    renderer = Renderer(truth, seed=seed)
    n = min(n, truth.n_frames)
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = 1920, 1080, "yuv420p"
        stream.options, stream.thread_count = {"preset": "veryfast", "crf": "20"}, 1
        for i in range(n):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(renderer.color(i), format="bgr24")))
        container.mux(stream.encode())
    return renderer, n


def decoded(path: Path) -> Iterator[Grey]:
    """The images' luma."""
    import av

    with av.open(str(path)) as container:
        stream: Any = container.streams.video[0]
        stream.codec_context.thread_type = "NONE"
        for frame in container.decode(stream):
            plane: Any = frame.planes[0]
            rows = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)
            yield rows[: frame.height, : frame.width]


def timed(path: Path, run: Callable[[Iterator[Grey]], list[Any]]) -> tuple[Floats, list[Any]]:
    """Milliseconds of processor time (n,) between images being asked for, decoding included."""
    clock = [time.thread_time()]

    def watched() -> Iterator[Grey]:
        for image in decoded(path):
            yield image
            clock.append(time.thread_time())

    found = run(watched())
    # what is done when there are no more images belongs to the last
    clock[-1] = time.thread_time()
    return 1e3 * np.diff(clock), found


def following(seed: int, frames: int) -> None:
    """A rendered session: followed, and searched in every frame."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session.mp4"
        renderer, _ = session(path, seed, frames)
        camera, boxes = renderer.cameras["color"], renderer.truth.prototypes
        detector = Detector(boxes, camera)
        default = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL))

        runs: dict[str, Callable[[Iterator[Grey]], list[Any]]] = {
            "decode": lambda images: [None for _ in images],
            "follow": lambda images: list(
                Tracker(detector, TrackParameters(prototypes=boxes)).follow(images)
            ),
            "ours": lambda images: [detector.search(image) for image in images],
            "OpenCV": lambda images: [default.detectMarkers(np.ascontiguousarray(i))[1] for i in images],
        }
        taken: dict[str, Floats] = {}
        results: dict[str, list[Any]] = {}
        # on a busy machine the least of some turns is nearest to what it takes, image by image
        for name in (*runs, *TURNS * ("decode", "follow", "ours")):
            ms, results[name] = timed(path, runs[name])
            taken[name] = np.minimum(ms, taken.get(name, ms))
        speeds({name: float(ms.mean()) for name, ms in taken.items()})
        compared(results["ours"], results["follow"])
        against_truth(renderer, results["follow"])


def speeds(taken: dict[str, float]) -> None:
    """Following against the two that it lies between; milliseconds per frame, all with decoding."""
    decode, fast = taken["decode"], taken["follow"]
    line(
        "ms per 1080p frame: decoding; following; searching every frame, ours, OpenCV's defaults",
        "; ".join(f"{taken[name]:.2f}" for name in ("decode", "follow", "ours", "OpenCV")),
    )
    for name, whose, targets in (
        ("ours", "our own search", ("<= 1.3 x", ">= 3 x")),
        ("OpenCV", "OpenCV's defaults", ("", "")),
    ):
        slow = taken[name]
        least = decode + (slow - decode) / EVERY
        line(
            f"following, of decoding and {whose} every {EVERY} frames ({least:.2f} ms)",
            f"{fast / least:.2f} x",
            targets[0],
        )
        line(
            f"{whose} in every frame takes longer than following (without decoding)",
            f"{slow / fast:.1f} x ({(slow - decode) / (fast - decode):.1f} x)",
            targets[1],
        )


def by_face(found: Sequence[Found]) -> dict[tuple[int, int, int], Floats]:
    """Rings by frame, box and face."""
    return {
        (i, b, f): ring
        for i, faces in enumerate(found)
        for b, f, ring in zip(faces.box.tolist(), faces.face.tolist(), faces.rings, strict=True)
    }


def compared(every: Sequence[Found], followed: Sequence[Found]) -> None:
    """What following loses against searching every frame."""
    slow, fast = by_face(every), by_face(followed)
    gaps = np.array([np.abs(slow[key] - fast[key]).max() for key in slow.keys() & fast.keys()])
    lost, more = len(slow.keys() - fast.keys()), len(fast.keys() - slow.keys())
    line(f"faces of {len(slow)} lost by following; found only by following", f"{lost}; {more}", "<= 0.2 %")
    line(
        "... corners differ by: median, 99 %", f"{np.median(gaps):.3f}, {np.percentile(gaps, 99):.3f} px", ""
    )


def against_truth(renderer: Renderer, followed: Sequence[Found]) -> None:
    """Recall, corners and false finds in the session."""
    fast = by_face(followed)
    found = total = false = 0
    errors: list[Floats] = []
    for i in range(len(followed)):
        seen = renderer.faces(i)
        clear = (seen.visible > 0.999) & (seen.tilt_rad < np.radians(65)) & (seen.side_px >= 24)
        for b, f in zip(*np.nonzero(clear), strict=True):
            total += 1
            if (ring := fast.get((i, int(b), int(f)))) is not None:
                found += 1
                pixels = (
                    seen.pixels[b, f][[1, 0, 3, 2]]
                    if renderer.cameras["color"].mirrored
                    else seen.pixels[b, f]
                )
                errors.append(np.linalg.norm(ring - pixels, axis=1))
        false += sum(bool(seen.visible[key[1:]] < 0.2) for key in fast if key[0] == i)
    line(
        f"faces found in the session ({total}, sides >= 24 px)",
        f"{100 * found / max(total, 1):.2f} %",
        ">= 99 %",
    )
    rmse = np.sqrt((np.array(errors) ** 2).mean())
    line("... corners, RMSE; faces found that are not in view", f"{rmse:.3f} px; {false}", "<= 0.2 px; 0")


# ------------------------------------------------------------------------------------------- false finds


def photographs(folders: Sequence[Path]) -> list[Grey]:
    """All images in the folders, and some of every video."""
    found: list[Grey] = []
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() in {".png", ".jpg", ".jpeg", ".ppm"} and "depth" not in str(path):
                image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
                if image is not None and min(image.shape) >= 128:
                    found.append(np.asarray(image, np.uint8))
            elif path.suffix.lower() == ".mkv":
                found += [image.copy() for i, image in enumerate(decoded(path)) if i % 10 == 0][:20]
    return found


def part_of(rng: np.random.Generator, photo: Grey) -> Grey:
    """A part of a photograph, turned, scaled, mirrored, blurred, noisy, brighter or darker."""
    scale, turn = np.exp(rng.uniform(np.log(0.4), np.log(2.5))), rng.uniform(0, 2 * np.pi)
    matrix = scale * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    matrix[:, 0] *= rng.choice([-1, 1])
    centre = rng.uniform(0, 1, 2) * photo.shape[::-1]
    affine = np.concatenate([matrix, (np.array([320.0, 240.0]) - matrix @ centre)[:, None]], 1)
    image = cv2.warpAffine(photo, affine, (640, 480), borderMode=cv2.BORDER_REFLECT).astype(np.float32)
    lit = np.clip(image * rng.uniform(0.6, 1.5), 0, 255).astype(np.float32)
    return exposed(lit, rng, blur_px=rng.uniform(0, 1.2), noise=rng.uniform(0, 6))


def page(rng: np.random.Generator) -> Grey:
    """Text of all sizes, squares, frames, chess boards and other grids."""
    image = np.full((480, 640), int(rng.integers(150, 255)), np.uint8)
    letters = list("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789#%&@[]{}|=+HIEDOB8")
    for _ in range(int(rng.integers(10, 60))):
        text, size = "".join(rng.choice(letters, int(rng.integers(3, 30)))), rng.uniform(0.3, 3)
        place = int(rng.integers(-50, 600)), int(rng.integers(0, 480))
        width, ink = int(max(1, size * rng.uniform(1, 4))), int(rng.integers(0, 120))
        cv2.putText(image, text, place, int(rng.integers(0, 8)), size, (ink,), width, cv2.LINE_AA)
    for _ in range(int(rng.integers(0, 12))):
        x, y, side, n = (int(rng.integers(*span)) for span in ((0, 600), (0, 440), (15, 80), (4, 9)))
        grid = rng.random((n, n)) < 0.5 if rng.random() < 0.5 else np.indices((n, n)).sum(0) % 2 > 0
        patch = cv2.resize(grid.astype(np.uint8) * 200 + 20, (side, side), interpolation=cv2.INTER_NEAREST)
        image[y : y + side, x : x + side] = patch[: 480 - y, : 640 - x]
        ink, width = int(rng.integers(0, 100)), int(rng.choice([-1, 2, 4, 8]))
        cv2.rectangle(image, (x + 40, y + 30), (x + 40 + side, y + 30 + side), (ink,), width)
    return exposed(image.astype(np.float32), rng, blur_px=rng.uniform(0, 1.2), noise=rng.uniform(0, 6))


def false_finds(seed: int, n: int, folders: Sequence[Path]) -> None:
    """Faces found where there is no marker, in single images; and objects, in all of them as a video."""
    rng = np.random.default_rng(seed)
    photos = photographs(folders)
    if not photos:
        print("no photographs: only text and patterns")
    sets = {
        "the ECAT glyphs": NOMINAL_BOXES,
        "DICT_5X5_50": own_boxes("DICT_5X5_50"),
        "DICT_4X4_50": own_boxes("DICT_4X4_50"),
    }
    detectors = {name: Detector(boxes) for name, boxes in sets.items()}
    seen: dict[str, dict[int, list[int]]] = {name: {} for name in sets}
    for i in range(n):
        image = part_of(rng, photos[int(rng.integers(len(photos)))]) if i % 2 and photos else page(rng)
        for name, detector in detectors.items():
            for box in detector.search(image).box.tolist():
                seen[name].setdefault(box, []).append(i)
    needed, within = TrackParameters().sightings, TrackParameters().within
    for name, boxes in seen.items():
        objects = sum(
            any(b - a < within for a, b in zip(rows, rows[needed - 1 :], strict=False))
            for rows in boxes.values()
        )
        faces = sum(map(len, boxes.values()))
        target = "0" if name == "the ECAT glyphs" else ""
        line(
            f"false objects in {n:,} images without markers, {name}",
            f"{objects} ({faces} single faces)",
            target,
        )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--full", action="store_true", help="10,000 images without markers, 1,000 frames")
    parser.add_argument("--photos", type=Path, nargs="*", default=[], help="more folders of photographs")
    parser.add_argument("--seed", type=int, default=7001)
    parser.add_argument("--figures", choices=("all", "following"), default="all", help="what to measure")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    data = Path(__file__).resolve().parents[2] / "shared" / "data"
    folders = [
        folder for folder in (data / "rgbd_images", data / "azure_kinect", *given.photos) if folder.is_dir()
    ]
    print("| what | reached | target |\n|---|---|---|")
    if given.figures == "all":
        corners(given.seed)
        recall(given.seed)
    following(given.seed, 1000 if given.full else 240)
    if given.figures == "all":
        false_finds(given.seed, 10_000 if given.full else 1000, folders)


if __name__ == "__main__":
    main()
