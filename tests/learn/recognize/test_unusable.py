"""Whatever is wrong with a model's folder, that is one error, and costs no more memory than a model does."""

from __future__ import annotations

import io
import json
import shutil
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecat.errors import CorruptError, EcatError, InputError, LimitError
from learn.recognize import kept
from learn.recognize.dataset import LabelledSession, read_exports
from learn.recognize.kept import read_arrays, read_config, require_free, write_arrays, write_json
from learn.recognize.runs import Options, load, save, train
from learn.recognize.unusable import labels_of, undamaged
from tests.learn.recognize import made

pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'ecat[learn]'")
OPTIONS = {
    "mixture": Options(trees=2, epochs=1, hidden=8),
    "hmm": Options(),
    "lds": Options(),
    "sparse-lstm-crf": Options(epochs=1, hidden=4),
}
FILES = {
    "mixture/trees": "model.npz",
    "mixture/neural": "network.npz",
    "sparse-lstm-crf": "network.npz",
    "hmm": "sequences.npz",
    "lds": "sequences.npz",
}
"""Folders below that of :func:`models`, and the arrays in them."""
Damage = Callable[[Path], object]


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> list[LabelledSession]:
    return read_exports(made.exports(tmp_path_factory.mktemp("exports"), 3))


@pytest.fixture(scope="module")
def models(sessions: list[LabelledSession], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    for name, options in OPTIONS.items():
        save(train(name, sessions, options)[0], folder / name)
    return folder


@pytest.fixture
def copy(models: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(models, tmp_path / "models"))


def refused(run: Path, kind: type[EcatError] = CorruptError) -> str:
    with pytest.raises(kind) as error:
        load(run)
    assert error.value.what == f"cannot use the model {run}"
    assert error.value.where
    assert error.value.fix
    return error.value.where


def changed(run: Path, path: tuple[str | int, ...], value: Any) -> None:
    """Change what config.json says at a path."""
    config = json.loads((run / "config.json").read_text("utf-8"))
    place = config
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    (run / "config.json").write_text(json.dumps(config), "utf-8")


def members(source: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(source) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def largest(parts: dict[str, bytes]) -> str:
    return max(parts, key=lambda name: len(parts[name]))


def packed(dest: Path, parts: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> None:
    with zipfile.ZipFile(dest, "w", method) as archive:
        for name, data in parts.items():
            archive.writestr(name, data)


def npy(values: Any) -> bytes:
    stream = io.BytesIO()
    np.save(stream, values, allow_pickle=True)
    return stream.getvalue()


def header(shape: tuple[int, ...], descr: str = "<f4") -> bytes:
    stream = io.BytesIO()
    said = {"descr": descr, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, said)  # pyright: ignore[reportArgumentType]
    return stream.getvalue()


def flipped(source: Path, name: str) -> None:
    """Bit rot in the middle of a packed member."""
    data = bytearray(source.read_bytes())
    with zipfile.ZipFile(source) as archive:
        info = archive.getinfo(name)
    start = info.header_offset + 30 + sum(struct.unpack("<HH", data[info.header_offset + 26 :][:4]))
    for place in range(start, start + min(40, info.compress_size)):
        data[place] ^= 0xFF
    source.write_bytes(data)


def claimed(source: Path, *, method: int | None = None, encrypted: bool = False) -> None:
    """All members say that they are packed in another way, or encrypted."""
    data = bytearray(source.read_bytes())
    with zipfile.ZipFile(source) as archive:
        places = [(info.header_offset, 6) for info in archive.infolist()]
        place = archive.start_dir
        for _ in archive.infolist():
            places.append((place, 8))
            place += 46 + sum(struct.unpack("<HHH", data[place + 28 : place + 34]))
    for start, flags in places:
        data[start + flags] |= encrypted
        if method is not None:
            data[start + flags + 2 : start + flags + 4] = struct.pack("<H", method)
    source.write_bytes(data)


CONFIGS: dict[str, str | bytes] = {
    "deep": "[" * 200_000,
    "deep objects": '{"a":' * 100_000,
    "a list": "[]",
    "a number": "3",
    "empty": "",
    "cut": '{"model": "tre',
    "not UTF-8": b"\xff\xfe{",
    "a long number": '{"features": ' + "9" * 5000 + "}",
    "NaN": '{"features": NaN}',
    "no finite number": '{"features": 1e999}',
    "long": '{"features": "' + "x" * kept.MOST_CONFIG_BYTES + '"}',
}


@pytest.mark.parametrize("text", CONFIGS.values(), ids=CONFIGS)
def test_a_config_that_is_damaged_is_one_error(text: str | bytes, tmp_path: Path) -> None:
    (tmp_path / "config.json").write_bytes(text if isinstance(text, bytes) else text.encode())
    refused(tmp_path)


VALUES: list[tuple[tuple[str | int, ...], Any]] = [
    *((("vocabulary", 0, slot), value) for slot, value in ((0, 300), (0, 100), (3, 9), (3, -1), (0, 0.5))),
    (("vocabulary", 0, 0), 10**400),
    (("vocabulary", 0), [1, 2, 3, 4, 3]),
    *((("vocabulary",), value) for value in ([], [[]], "no", None, 3, {}, [[0] * 5] * 2)),
    *((("habits", "never_arrives"), value) for value in (0, 1, -1, "x", None, 10**400, [])),
    *((("habits",), value) for value in ([], {"none": 0.5}, "x", None)),
    *((("trained_on",), value) for value in (5, None)),
]


@pytest.mark.parametrize("name", ["mixture/trees", "mixture/neural", "hmm"])
@pytest.mark.parametrize(("path", "value"), VALUES)
def test_a_config_that_says_what_cannot_be_is_one_error(
    path: tuple[str | int, ...], value: Any, name: str, models: Path, tmp_path: Path
) -> None:
    run = Path(shutil.copytree(models / name, tmp_path / "run"))
    changed(run, path, value)
    refused(run)


@pytest.mark.parametrize(
    ("name", "path", "value"),
    [
        *(("mixture/trees", ("table", "slope"), value) for value in ("x", None, 10**400)),
        ("mixture/trees", ("table",), []),
        *(("hmm", ("fit", 0), value) for value in ("x", None, 10**400)),
        ("hmm", ("fit",), [1, 2]),
        *(
            ("mixture/neural", ("settings", "hidden"), value)
            for value in (10**9, 20_000, 0, -1, 8.0, "8", 10**30, True, 9)
        ),
        *(("mixture/neural", ("settings", "members"), value) for value in (0, -1, 10**6, 3)),
        *(("mixture/neural", ("settings", "keep"), value) for value in (5, 0, "x", None)),
        *(("mixture/neural", ("settings", "model"), value) for value in ("mlp", [], None, 5)),
        ("mixture/neural", ("settings",), []),
        ("mixture/neural", ("settings", "more"), 1),
        *(("sparse-lstm-crf", ("settings", "layers"), value) for value in (0, 2, 2000, 10**9, "1")),
        ("sparse-lstm-crf", ("settings", "crf_weight"), "x"),
        ("sparse-lstm-crf", ("settings", "carries"), "x"),
    ],
)
def test_settings_that_cannot_be_are_one_error(
    name: str, path: tuple[str | int, ...], value: Any, models: Path, tmp_path: Path
) -> None:
    run = Path(shutil.copytree(models / name, tmp_path / "run"))
    changed(run, path, value)
    refused(run)


@pytest.mark.parametrize("name", [None, [], {}, "oracle", 5])
def test_a_kind_of_model_that_there_is_not_is_refused_by_name(name: Any, tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text(json.dumps({"model": name}), "utf-8")
    assert str(name) in refused(tmp_path, InputError)


MEMBERS: dict[str, Any] = {
    "a pickle": npy(np.array([{"a": 1}], object)),
    "text": npy(np.array(["a", "b"])),
    "complex": npy(np.ones(3, complex)),
    "records": npy(np.zeros(3, [("a", "f4")])),
    "times": npy(np.zeros(3, "M8[s]")),
    "one number": npy(np.float32(3)),
    "nothing": b"",
    "no array": b"hello",
    "a bad header": b"\x93NUMPY\x01\x00\x10\x00{{{{{{{{{{{{{{{\n",
    "a null in the header": b'\x93NUMPY\x01\x00\x10\x00{"descr":\x00      \n',
    "a deep header": b"\x93NUMPY\x03\x00" + struct.pack("<I", 20_000) + b"(" * 19_999 + b"\n",
    "far too many": header((10**12,)) + b"abc",
    "beyond 64 bits": header((10**30,)) + b"abc",
    "a product beyond": header((2**62, 4)),
    "less than none": header((-5,)),
    "less than none, twice": header((-1, -1)) + b"abcd",
    "an object": header((3,), "|O") + b"abc",
    "void": header((3,), "|V8") + b"a" * 24,
    "other numbers": npy(np.zeros((3, 3, 3, 3))),
    "long double": npy(np.zeros(3, np.longdouble)),
}


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("data", MEMBERS.values(), ids=MEMBERS)
def test_an_array_that_is_damaged_is_one_error(data: bytes, name: str, models: Path, tmp_path: Path) -> None:
    run = Path(shutil.copytree(models / name, tmp_path / "run"))
    parts = members(run / FILES[name])
    packed(run / FILES[name], parts | {largest(parts): data})
    refused(run)


@pytest.mark.parametrize("name", FILES)
def test_numbers_that_are_not_known_are_refused(name: str, models: Path, tmp_path: Path) -> None:
    run = Path(shutil.copytree(models / name, tmp_path / "run"))
    parts = members(run / FILES[name])
    numbers = [key for key in parts if np.load(io.BytesIO(parts[key])).dtype.kind == "f"]
    for member in (numbers[0], numbers[-1]):
        values = np.load(io.BytesIO(parts[member]))
        packed(run / FILES[name], parts | {member: npy(np.full_like(values, np.nan))})
        assert member.removesuffix(".npy") in refused(run)


@pytest.mark.parametrize("kind", ["hmm", "lds"])
@pytest.mark.parametrize("change", [lambda v: v[:1], np.ravel, lambda v: v[..., :1], lambda v: v - np.inf])
def test_models_of_sequences_that_fit_nothing_are_refused(
    change: Callable[[Any], Any], kind: str, models: Path, tmp_path: Path
) -> None:
    run = Path(shutil.copytree(models / kind, tmp_path / "run"))
    with np.load(run / "sequences.npz") as arrays:
        kept_arrays = dict(arrays)
    for name, values in kept_arrays.items():
        np.savez(run / "sequences.npz", **(kept_arrays | {name: change(values)}))
        refused(run)


def rot(source: Path) -> None:
    packed(source, members(source))
    flipped(source, largest(members(source)))


DAMAGE: dict[str, Damage] = {
    "bit rot": rot,
    "empty": lambda source: source.write_bytes(b""),
    "cut": lambda source: source.write_bytes(source.read_bytes()[:-100]),
    "one array": lambda source: source.write_bytes(npy(np.zeros(3))),
    "a pickle": lambda source: source.write_bytes(b"\x80\x04K\x01."),
    "a folder": lambda source: (source.unlink(), source.mkdir()),
    "missing": Path.unlink,
    "LZMA": lambda source: packed(source, members(source), zipfile.ZIP_LZMA),
    "an unknown method": lambda source: claimed(source, method=99),
    "encrypted": lambda source: claimed(source, encrypted=True),
    "one array less": lambda source: packed(source, dict(list(members(source).items())[1:])),
    "more than arrays": lambda source: packed(source, members(source) | {"evil.txt": b"abc"}),
}


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_a_file_that_is_damaged_is_one_error(damage: Damage, name: str, models: Path, tmp_path: Path) -> None:
    run = Path(shutil.copytree(models / name, tmp_path / "run"))
    damage(run / FILES[name])
    refused(run)


def test_any_byte_that_rots_is_the_same_model_or_one_error(
    sessions: list[LabelledSession], models: Path, tmp_path: Path
) -> None:
    run = Path(shutil.copytree(models / "mixture/trees", tmp_path / "run"))
    whole, generator = (run / "model.npz").read_bytes(), np.random.default_rng(0)
    expected = load(run).recognize([sessions[0].points]).context
    for place in generator.integers(len(whole), size=25):
        (run / "model.npz").write_bytes(whole[:place] + bytes([whole[place] ^ 0x55]) + whole[place + 1 :])
        try:
            found = load(run).recognize([sessions[0].points]).context
        except CorruptError:
            continue
        np.testing.assert_array_equal(found, expected)  # a date in the archive, say


def swapped(run: Path) -> None:
    (run / "trees").rename(run / "other")
    (run / "neural").rename(run / "trees")
    (run / "other").rename(run / "neural")


def both(of: str, other: str) -> Damage:
    return lambda run: (shutil.rmtree(run / other), shutil.copytree(run / of, run / other))


@pytest.mark.parametrize("damage", [swapped, both("trees", "neural"), both("neural", "trees")])
def test_a_mixture_of_other_parts_is_refused(damage: Damage, copy: Path) -> None:
    damage(copy / "mixture")
    refused(copy / "mixture")


def test_what_is_packed_small_is_not_unpacked_large(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Zeros that are of no use, or in the place of an array that is."""
    monkeypatch.setattr(kept, "MOST_BYTES", 1 << 25)
    run = copy / "mixture/neural"
    parts = members(run / "network.npz")
    for name in ("zeros.npy", next(iter(parts))):
        packed(run / "network.npz", {key: value for key, value in parts.items() if key != name})
        with (
            zipfile.ZipFile(run / "network.npz", "a", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
            archive.open(name, "w", force_zip64=True) as stream,
        ):
            stream.write(header((kept.MOST_BYTES // 4,)))
            for _ in range(kept.MOST_BYTES >> 24):
                stream.write(bytes(1 << 24))
        tracemalloc.start()
        refused(run)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 8e6


def test_arrays_and_configs_come_back_as_they_were_written(tmp_path: Path) -> None:
    arrays = {
        "a.b": np.arange(6, dtype=np.int32).reshape(2, 3),
        "by columns": np.asfortranarray(np.random.default_rng(0).normal(size=(3, 4))),
        "none": np.zeros((0, 4), np.float32),
        "one": np.float64(-np.inf) * np.ones(()),
        "true": np.array([True, False]),
    }
    for compressed in (False, True):
        write_arrays(tmp_path / "a.npz", arrays, compressed=compressed)
        found = read_arrays(tmp_path / "a.npz", set(arrays))
        assert set(found) == set(arrays)
        for name, values in arrays.items():
            assert found[name].dtype == values.dtype
            np.testing.assert_array_equal(found[name], values)
    write_json({"a": [1, 0.5, None, "ü"]}, tmp_path / "config.json")
    assert read_config(tmp_path) == {"a": [1, 0.5, None, "ü"]}


def test_what_could_not_be_read_again_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="cannot keep") as error:
        write_arrays(tmp_path / "a.npz", {"b": np.array([1, np.nan])})
    assert "b has" in error.value.where
    with pytest.raises(InputError, match="cannot write"):
        write_json({"a": float("nan")}, tmp_path / "a.json")
    monkeypatch.setattr(kept, "MOST_BYTES", 100)
    with pytest.raises(LimitError):
        write_arrays(tmp_path / "a.npz", {"b": np.zeros(13)})
    assert not list(tmp_path.iterdir())


def test_a_place_that_is_taken_is_told_before_the_work_and_nothing_is_left(tmp_path: Path) -> None:
    require_free(tmp_path / "new/deep", ("a.json", "b.npz"))
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").write_text("x", "utf-8")
    (tmp_path / "a.json").write_text("mine", "utf-8")
    for folder in (tmp_path, tmp_path / "file", tmp_path / "file/deep"):
        with pytest.raises(EcatError):
            require_free(folder, ("a.json",))
    (tmp_path / "a.json").write_text("{}", "utf-8")
    require_free(tmp_path, ("a.json",))
    assert {path.name for path in tmp_path.iterdir()} == {"file", "a.json"}


def test_errors_that_say_what_is_wrong_are_left_as_they_are() -> None:
    with pytest.raises(InputError, match="mine"), undamaged("cannot"):
        raise InputError("mine", where="here", fix="do")
    with pytest.raises(CorruptError, match="cannot") as error, undamaged("cannot"):
        raise KeyError("name")
    assert error.value.where == "KeyError: 'name'"


def test_labels_have_both_names_of_the_boxes() -> None:
    both_names = [[1, 2, 0, 1, 0], [1, 3, 0, 1, 0]]
    assert labels_of({"vocabulary": both_names}).tolist() == both_names
    with pytest.raises(ValueError, match="exchanged"):
        labels_of({"vocabulary": both_names[:1]})


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (Path.unlink, "model.npz: No such file"),
        (lambda file: file.write_bytes(file.read_bytes()[:1000]), "its arrays are cut off"),
        (lambda file: (file.parent / "config.json").write_text('{"features":'), "its JSON is cut off"),
    ],
)
def test_what_is_missing_or_cut_off_is_named(damage: Damage, said: str, copy: Path) -> None:
    damage(copy / "mixture/trees/model.npz")
    with pytest.raises(CorruptError) as caught:
        load(copy / "mixture")
    assert said in caught.value.where
    assert "Errno" not in str(caught.value)
