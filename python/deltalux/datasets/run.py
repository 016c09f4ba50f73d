"""`dl.dataset`: what is asked is written down, cameras get their transports, and shards are handed out."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._core import __version__, threads
from ..camera import Camera
from ..checks import count as whole
from ..io import auto_exposure
from ..light.environment import Environment
from ..mistakes import checked_path, described, instead_of, kind_of
from ..output import check_writable, keep_out
from ..plain import MOST_TEXT, read_plain
from ..precomputation.run import precompute
from ..progress import Progress, Reporter, steps
from ..relight.backdrop import checked_backdrop
from ..scene.scene import Scene
from ..tasks import checked_executor, completed, spawned
from ..transport.aov import AOVS
from ..transport.transport import Transport
from .arrays import Place, array_of
from .cameras import read_cameras
from .encoding import PICTURES, Format
from .lights import LightRecipe, LightRule, Source, read_recipes, sources_of
from .shards import CAMERAS, SHARDS, Made, Shard, camera_layers, write_shard

if TYPE_CHECKING:
    import dask.array

__all__ = ["LAYERS", "Dataset", "dataset"]

LAYERS = (*AOVS, *PICTURES[1:])
"""What samples may have besides their pictures."""
SPLITS = {"train": 0.8, "val": 0.1, "test": 0.1}
_MANIFEST, _LIGHTS, _TRANSPORTS = "dataset.json", "lights.jsonl", "transports"
_FORMAT = "deltalux dataset"


@dataclass(frozen=True)
class Dataset:
    """What was made.

    Attributes
    ----------
    folder
        Where it is.
    pictures
        How many there are.
    made
        How many of them are new; the others were there.
    seconds
        What the new ones took, of all workers together.
    encoding
        What of it files took.
    """

    folder: Path
    pictures: int
    made: int
    seconds: float
    encoding: float
    _shards: tuple[Place, ...] = field(default=(), repr=False)
    _size: tuple[int, int] = field(default=(0, 0), repr=False)

    def array(self) -> dask.array.Array:
        """All pictures as one array of dask's, read as it is asked for.

        Returns
        -------
        dask.array.Array
            (pictures, height, width, 3) float32: linear radiance, without alpha; of 16-bit PNGs what they show.

        Raises
        ------
        ValueError
            If dask is missing, or cameras have pictures of different sizes.
        """
        if self._size == (0, 0):
            raise ValueError("expected cameras of one size for one array, but theirs differ")
        return array_of(self._shards, self._size)

    def __str__(self) -> str:
        there = f"{self.folder} holds {self.pictures:,} pictures"
        if not self.made:
            return f"{there}, which were there already"
        share = 100 * self.encoding / self.seconds if self.seconds else 0.0
        each = 1e3 * self.seconds / self.made
        return f"{there}, of which {self.made:,} are new: {each:.1f} ms each, of which files are {share:.0f} %"


def dataset(
    source: Scene | Transport,
    folder: str | os.PathLike[str],
    lights: LightRule | Sequence[LightRecipe] | str | os.PathLike[str] | None = None,
    count: int | None = None,
    *,
    seed: int = 0,
    cameras: Sequence[Camera] | str | os.PathLike[str] = (),
    layers: Sequence[str] = ("mask",),
    format: str = "exr",
    half: bool = True,
    compression: int = 1,
    tar: bool = False,
    background: str = "env",
    exposure: float | str | None = None,
    coefficients: bool = False,
    splits: Mapping[str, float] | None = None,
    shard: int = 64,
    jobs: int | None = None,
    executor: Executor | None = None,
    progress: bool | Progress = True,
    **precomputing: Any,
) -> Dataset:
    """Makes pictures of a scene under many lights, with all that is known of each.

    Every camera sees every light: picture k n + i is of camera k under light i of n. A run that is interrupted goes on
    where it stopped when it is called again; the same request leaves the same bytes, whoever does it
    and in whatever order.

    Parameters
    ----------
    source
        The scene, or its transport.
    folder
        Made if it is not there; a data set of another request in it is refused.
    lights
        The rule that draws them, by default `LightRule()`; or a list of them; or a file with one on each line, in JSON.
    count
        How many lights are drawn, by default 1,000; of a list that is all of it.
    seed
        Of the rule, and of the splits.
    cameras
        By default that of the source; `turntable` makes some. Or a JSON file, a list of objects with the fields of
        `Camera`. Those after the first take the first one's nodes over (`Transport.for_camera`).
    layers
        ``"mask"``, ``"albedo"``, ``"normal"``, ``"depth"``, ``"position"``, ``"material"``, as of `Transport.aov`,
        once a camera, or in each sample of a tar; and ``"direct"`` and ``"indirect"``, which add up to the surfaces
        of a picture: light that surfaces give off is direct.
    format, half, compression
        ``"exr"`` or ``"npz"`` in linear radiance, half floats or not, or ``"png16"``, sRGB in 16 bits; compression from
        0, none, to 9, the slowest.
    tar
        Whether shards are tar files, as webdataset reads them, in the place of folders.
    background
        ``"env"``, ``"none"``, with alpha, or a colour ``"#rrggbb"``.
    exposure
        Of ``"png16"`` in stops; None: what suits the first camera under even light of radiance 1, for all;
        ``"each"``: what suits a picture.
    coefficients
        Whether V is kept with every picture, (columns, 3) float64.
    splits
        Names and shares; by default four fifths to train, a tenth to val and to test. A light is in one of them for all
        cameras.
    shard
        Pictures of a task.
    jobs
        So many processes, in the place of threads of this one.
    executor
        Whoever else does the tasks: any of `concurrent.futures`, Dask's or MPI's, whose workers see the same files.
    progress
        True: a bar on standard error. A callable: progress(pictures done, pictures in all), for each step anew.
    **precomputing
        Of a scene: keywords of `precompute`.

    Returns
    -------
    Dataset

    Raises
    ------
    TypeError, ValueError
        If an argument cannot be used, before any long work.
    FileExistsError
        If something else is in the folder.
    OSError
        If the disk refuses; what was finished is kept.
    """
    checked_path(folder, "a scene or a transport, and then a folder")
    seed = whole("seed", seed)
    known = _recipes(lights, count, seed)
    asked = _Asked(
        source,
        seed,
        known,
        tuple(_cameras(source, cameras)),
        _layers(source, layers),
        Format(format, half, compression),
        bool(tar),
        checked_backdrop(background),
        _stops(exposure),
        bool(coefficients),
        tuple(_shares(SPLITS if splits is None else splits).items()),
        whole("shard", shard),
        precomputing,
    )
    if jobs is not None and executor is not None:
        raise ValueError("expected jobs or an executor, got both")
    if asked.shard < 1:
        raise ValueError(f"expected at least one picture a shard, got {shard}")
    return _Run(asked, Path(folder).absolute()).run(jobs, checked_executor(executor), progress)


@dataclass(frozen=True, eq=False)
class _Asked:
    """All that decides what is in a data set, checked."""

    source: Scene | Transport
    seed: int
    recipes: tuple[LightRecipe, ...]
    cameras: tuple[Camera, ...]
    layers: tuple[str, ...]
    format: Format
    tar: bool
    background: str
    exposure: float | str | None
    coefficients: bool
    splits: tuple[tuple[str, float], ...]
    shard: int
    precomputing: Mapping[str, Any]

    def manifest(self, sources: Mapping[str, Source]) -> dict[str, Any]:
        """As it is written down: another request says something else."""
        plain = ("seed", "layers", "tar", "background", "exposure", "coefficients", "shard")
        of = self.source
        return {
            "format": _FORMAT,
            "version": 1,
            "software": f"deltalux {__version__}",
            "source": {"transport": of.digest} if isinstance(of, Transport) else {"scene": of.content_hash()},
            "precomputing": {name: str(value) for name, value in self.precomputing.items()},
            "lights": len(self.recipes),
            "environments": {name: asdict(source) for name, source in sources.items()},
            "cameras": [asdict(camera) for camera in self.cameras],
            "files": asdict(self.format),
            "splits": dict(self.splits),
            **{name: getattr(self, name) for name in plain},
        }


class _Run:
    """One run into a folder."""

    def __init__(self, asked: _Asked, folder: Path) -> None:
        self.asked, self.folder = asked, folder
        self.sources = sources_of(asked.recipes)

    def run(self, jobs: int | None, executor: Executor | None, progress: bool | Progress) -> Dataset:
        """Every step in its order; what is there is not done again."""
        self._claim()
        step_of = steps(progress, "dataset", len(self.asked.cameras) + 1)
        transports = [self._transport(k, executor, step_of(f"camera {k}")) for k in range(len(self.asked.cameras))]
        exposure = self._exposure(transports[0])
        still = [self._still(k, transport, exposure) for k, transport in enumerate(transports)]
        shards = list(self._shards(transports, still, exposure))
        return self._made(shards, jobs, executor, step_of("pictures"))

    def _claim(self) -> None:
        """Makes the folder and writes down what is asked, or finds the same there."""
        said = json.dumps(self.asked.manifest(self.sources), sort_keys=True, indent=1) + "\n"
        lights = "".join(f"{recipe.to_json()}\n" for recipe in self.asked.recipes)
        check_dataset_folder(self.folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        keep_out(self.folder)
        kept = self.folder / _MANIFEST
        if kept.exists():
            same = (
                read_plain(kept, MOST_TEXT) == said.encode()
                and read_plain(self.folder / _LIGHTS, 1 << 32) == lights.encode()
            )
            if not same:
                raise FileExistsError(
                    f"{self.folder} holds a data set of another request; give another folder, or remove it"
                )
        for name in (SHARDS, CAMERAS, _TRANSPORTS):
            (self.folder / name).mkdir(exist_ok=True)
        # What killed workers left; a shard is never begun under such a name twice.
        for left in (self.folder / SHARDS).glob(".*"):
            shutil.rmtree(left, ignore_errors=True)
        if not kept.exists():
            # The manifest last: what has one has its lights.
            (self.folder / _LIGHTS).write_text(lights, encoding="utf-8")
            beside = kept.with_name(f".{kept.name}")
            beside.write_text(said, encoding="utf-8")
            os.replace(beside, kept)

    def _transport(self, k: int, executor: Executor | None, tell: Reporter) -> Transport:
        """M as a camera sees it: made once, and found again."""
        source, camera = self.asked.source, self.asked.cameras[k]
        if isinstance(source, Transport):
            if source.receivers.kind == "vertices" or camera == source.camera:
                return source
        first, path = self.folder / _TRANSPORTS / "000.transport", self.folder / _TRANSPORTS / f"{k:03}.transport"
        if k == 0 and isinstance(source, Scene):
            return precompute(
                source.with_camera(camera), path, progress=tell, executor=executor, **self.asked.precomputing
            )
        of = source if isinstance(source, Transport) else Transport.open(first)
        if of.receivers.kind == "vertices":
            return of
        if kind_of(path).startswith("a transport"):
            return Transport.open(path)
        return of.for_camera(camera, path, progress=tell)

    def _exposure(self, transport: Transport) -> float | None:
        """In stops; None: each picture has its own."""
        exposure = self.asked.exposure
        if exposure == "each":
            return None
        if exposure is not None:
            return float(exposure)
        even = Environment.from_cubemap(np.ones((6, 1, 1, 3), np.float32))
        B = transport.multiply(transport.coefficients(even))
        return auto_exposure(transport.seen(B, self._view(transport, 0)).picture())

    def _view(self, transport: Transport, k: int) -> Camera | None:
        return self.asked.cameras[k] if transport.receivers.kind == "vertices" else None

    def _still(self, k: int, transport: Transport, exposure: float | None) -> dict[str, str]:
        """Writes what no light changes, where samples do not have it themselves; as sidecars name it."""
        if self.asked.tar:
            return {}
        place = self.folder / CAMERAS / f"{k:03}"
        place.mkdir(exist_ok=True)
        arrays = camera_layers(transport, self.asked.layers)
        names = self.asked.format.write(place, f"{k:03}", arrays, exposure or 0.0) if arrays else {}
        return {layer: f"../../{CAMERAS}/{k:03}/{name}" for layer, name in names.items()}

    def _shards(
        self, transports: Sequence[Transport], still: Sequence[Mapping[str, str]], exposure: float | None
    ) -> Iterator[Shard]:
        """All tasks: each camera's lights in pieces."""
        asked, number = self.asked, 0
        for view, transport in enumerate(transports):
            for first in range(0, len(asked.recipes), asked.shard):
                lights = range(first, min(first + asked.shard, len(asked.recipes)))
                yield Shard(
                    str(self.folder),
                    number,
                    view * len(asked.recipes) + first,
                    asked.recipes[lights.start : lights.stop],
                    lights,
                    transport,
                    asked.cameras[view],
                    view,
                    self.sources,
                    still[view],
                    asked.layers,
                    asked.format,
                    asked.tar,
                    asked.background,
                    exposure,
                    asked.coefficients,
                    asked.seed,
                    asked.splits,
                )
                number += 1

    def _made(self, shards: Sequence[Shard], jobs: int | None, executor: Executor | None, tell: Reporter) -> Dataset:
        """Hands out the shards that are missing, and adds up what they took."""
        missing = [shard for shard in shards if not shard.place.exists()]
        pictures = sum(len(shard.recipes) for shard in shards)
        done = pictures - sum(len(shard.recipes) for shard in missing)
        tell(done, pictures)
        all_made: list[Made] = []
        with _workers(jobs, executor) as who, closing(completed(write_shard, missing, who)) as finished:
            for number, made in finished:
                all_made.append(made)
                done += len(missing[number].recipes)
                tell(done, pictures)
        sums = [sum(getattr(made, name) for made in all_made) for name in ("pictures", "seconds", "encoding")]
        sizes = {(camera.height, camera.width) for camera in self.asked.cameras}
        places = tuple((shard.place, shard.first, len(shard.recipes)) for shard in shards)
        size = sizes.pop() if len(sizes) == 1 else (0, 0)
        return Dataset(self.folder, pictures, sums[0], sums[1], sums[2], places, size)


@contextmanager
def _workers(jobs: int | None, executor: Executor | None) -> Iterator[Executor]:
    """Who does the tasks: the user's, processes, or threads of this one."""
    if executor is not None:
        yield executor
    elif jobs is not None:
        with spawned(jobs) as processes:
            yield processes
    else:
        with ThreadPoolExecutor(threads(), "deltalux-dataset") as own:
            yield own


def check_dataset_folder(folder: Path) -> None:
    """What would be refused about a folder, before any work; writes nothing."""
    check_writable(folder, "a folder for a data set")
    if folder.is_dir() and any(folder.iterdir()) and not _is_dataset(folder):
        raise FileExistsError(f"{folder} holds something else than a data set; give another folder")


def _is_dataset(folder: Path) -> bool:
    try:
        found = json.loads(read_plain(folder / _MANIFEST, MOST_TEXT))
        return isinstance(found, dict) and found.get("format") == _FORMAT
    except FileNotFoundError:
        # A run that was stopped before it had written down what is asked.
        return all(
            name in (_LIGHTS, f".{_MANIFEST}", SHARDS, CAMERAS, _TRANSPORTS, ".deltalux-files")
            for name in os.listdir(folder)
        )
    except (ValueError, RecursionError):
        return False


def _recipes(lights: Any, number: int | None, seed: int) -> tuple[LightRecipe, ...]:
    if lights is None or isinstance(lights, LightRule):
        number = 1000 if number is None else whole("count", number)
        if not number:
            raise ValueError("expected at least one light, got 0")
        return tuple((lights or LightRule()).recipes(number, seed))
    if number is not None:
        raise ValueError(f"expected a count of lights that are drawn, got {number} of a list")
    if isinstance(lights, (str, os.PathLike)):
        return tuple(read_recipes(lights))
    found = tuple(lights) if isinstance(lights, Sequence) else ()
    if not found or not all(isinstance(recipe, LightRecipe) for recipe in found):
        raise TypeError(f"expected a LightRule, LightRecipes, or a file of them, got {described(lights)}")
    return found


def _cameras(source: Any, cameras: Any) -> list[Camera]:
    if not isinstance(source, (Scene, Transport)):
        raise TypeError(f"expected a Scene or a Transport, and then a folder, got {described(source)}")
    if isinstance(cameras, (str, os.PathLike)):
        return read_cameras(cameras, source.camera)
    found = [cameras] if isinstance(cameras, Camera) else list(cameras)
    for camera in found:
        if not isinstance(camera, Camera):
            raise instead_of("Camera", camera)
    return found or [source.camera]


def _layers(source: Scene | Transport, layers: Sequence[str]) -> tuple[str, ...]:
    found = (layers,) if isinstance(layers, str) else tuple(layers)
    unknown = [name for name in found if name not in LAYERS]
    if unknown:
        raise ValueError(f"expected layers of {', '.join(LAYERS)}, got {unknown[0]!r}")
    if found and isinstance(source, Transport) and source.receivers.kind != "pixels":
        kind = source.receivers.kind
        raise ValueError(f"expected a transport of pixels for layers, but its rows are {kind}; ask for no layers")
    return tuple(name for name in LAYERS if name in found)


def _stops(exposure: float | str | None) -> float | str | None:
    if exposure is None or exposure == "each":
        return exposure
    if isinstance(exposure, bool) or not isinstance(exposure, (int, float)) or not abs(exposure) <= 64:
        raise ValueError(f'expected an exposure in stops, from -64 to 64, or "each", got {exposure!r}')
    return float(exposure)


def _shares(splits: Mapping[str, float]) -> dict[str, float]:
    good = isinstance(splits, Mapping) and splits and all(isinstance(k, str) and k for k in splits)
    if not good or not all(isinstance(x, (int, float)) and 0 < x < float("inf") for x in splits.values()):
        raise ValueError(f'expected splits like {{"train": 0.9, "test": 0.1}}, shares above 0, got {splits!r}')
    return {name: float(share) for name, share in splits.items()}
