"""Transport: M of a scene on disk, the larger by memory map, with all that makes pictures of its products."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, lru_cache
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Behind, FileError
from .._core import Transport as CoreTransport
from ..camera import Camera
from ..columns.haar import Haar
from ..columns.inner import AnyColumns, parse_any
from ..columns.lamps import Lamps
from ..mistakes import checked_path, described, instead_of, refuse_kind, refuse_missing
from ..plain import MOST_TEXT, read_plain
from ..progress import Progress
from ..surface.surface import Surface
from .aov import aov
from .clusters import build, colours_of
from .entry import GROUP
from .makers import made
from .matrix import Matrix
from .mesh import save_mesh
from .plan import Plan, Solve
from .receivers import Pixels, Receivers, Vertices, of_table
from .seen import Seen, Shares
from .stack import write_stack
from .verifying import verified
from .views import Views

if TYPE_CHECKING:
    from ..light.environment import Environment

__all__ = ["Transport"]

# What the core calls the file that names all others.
_MANIFEST = "manifest.json"
_STOPS = 64


class Transport(Matrix):
    """The light transport matrix M of a still scene: B = M V.

    Made by `precompute` and opened by its path. Nothing in it changes: any number of relighters share one. A copy is
    the transport itself, and what is pickled is the path and what stood there: a worker opens it again, and refuses
    another.

    Parameters
    ----------
    path
        The directory that `precompute` made, as for `open`; or a transport of the core.

    Raises
    ------
    TypeError
        If it is no path.
    FileError, OSError
        As for `open`.
    """

    def __init__(self, path: str | os.PathLike[str] | CoreTransport) -> None:
        if isinstance(path, CoreTransport):
            self._path = None
            super().__init__(path)
        else:
            checked_path(path, "the path of a transport")
            refuse_kind(path, "a transport")
            refuse_missing(path)
            super().__init__(CoreTransport.open(path))
            self._path = Path(path).absolute()

    @staticmethod
    def open(path: str | os.PathLike[str]) -> Transport:
        """Opens a transport directory, a large one by memory map, after checking every file in it.

        Parameters
        ----------
        path
            The directory that `precompute` made, with whatever version.

        Returns
        -------
        Transport

        Raises
        ------
        FileError
            (a ValueError) If a file is truncated, altered, of another version, or not what it claims to be.
        OSError
            If a file cannot be read.
        """
        return Transport(path)

    @staticmethod
    def from_images(
        images: Any,
        lights: Any,
        path: str | os.PathLike[str],
        *,
        mask: ArrayLike | str | os.PathLike[str] | None = None,
        intensities: ArrayLike | None = None,
        reach: float | None = None,
        camera: Camera | None = None,
        progress: bool | Progress = True,
    ) -> Transport:
        """The transport that pictures of one view hold, each taken under one lamp or one group of lights.

        Columns are the lights (`Lamps`): an environment is shared out between lamps by their directions, a group's
        number in V is its gain. All light that a picture holds is in M, shadows, gloss and what has bounced.

        Parameters
        ----------
        images
            (n, height, width, 3) or (n, height, width) linear floats, or a sequence of such or of files, which are made
            linear as `Environment.load` does. One file where `lights` names its layers or parts (EXR). None where a
            list of lights names the pictures.
        lights
            (n, 3) directions towards the lamps; `Lamps`; names of groups; or a text file: a number, then a line for
            each light with its direction, behind the name of its picture in RTI's .lp.
        path
            Directory to make, by custom ``NAME.transport``.
        mask
            (height, width), or a picture: where False or dark, no surface is seen. None: all of it is surface.
        intensities
            (n,) or (n, 3): the irradiance of a surface that faces each lamp, or what pictures of groups are divided by;
            None: 1.
        reach
            As for `Lamps`, degrees.
        camera
            The one that took them. None: one that looks along -z, as light stacks are measured.
        progress
            As for `precompute`.

        Returns
        -------
        Transport
            Opened from `path`: of three channels, or of one where all pictures are grey. What surfaces are is not
            known: albedos are 1, places and normals 0.

        Raises
        ------
        TypeError, ValueError
            If an argument cannot be used, or the pictures are not of one size.
        OSError
            If a file cannot be read or written.
        """
        checked_path(path)
        write_stack(images, lights, path, mask, intensities, reach, camera, progress)
        return Transport.open(path)

    def __reduce__(self) -> tuple[Any, ...]:
        if self._path is None:
            raise TypeError("expected a transport in a file to pickle, but this one is in memory only")
        return _reopened, (str(self._path), _content(self._path))

    def __copy__(self) -> Transport:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Transport:
        return self

    @cached_property
    def direct(self) -> Matrix:
        """M without what light between surfaces adds to its rows: the same columns and rows, in memory; ValueError of
        two stages."""
        return Matrix(self._core.direct())

    @property
    def digest(self) -> str:
        """What tells this transport from any other, bit for bit; ValueError where it is in memory only."""
        if self._path is None:
            raise ValueError("expected a transport in a file, but this one is in memory only")
        return _content(self._path)

    @property
    def factors(self) -> int:
        """How many responses make up what is seen of a receiver: of a mix, or of the lobes of vertices, which a view
        mixes; 1 where there is nothing to mix."""
        planned = [1]
        # What was made in memory has no plan.
        with suppress(ValueError):
            planned = [part.factors for part in self.plan.parts]
        return max(self._core.factors, *planned)

    @property
    def bounces(self) -> int:
        """Of light between surfaces that it holds: 0, so many, or -1 for all."""
        bounces = [part.bounces for part in self.plan.parts]
        return -1 if -1 in bounces else max(bounces)

    @property
    def nodes(self) -> int:
        """How many points light between surfaces was solved at; 0 where there is none."""
        return self.plan.solve.nodes if self.plan.solve else 0

    @property
    def solve(self) -> Solve | None:
        """How light between surfaces was solved; None where there is none."""
        return self.plan.solve

    @property
    def version(self) -> tuple[int, int]:
        """(major, minor) of the format that the file is written in."""
        major, minor = self._core.version
        return major, minor

    @property
    def files(self) -> list[tuple[str, int]]:
        """Names of the files in the directory, and their bytes."""
        return self._core.files

    @cached_property
    def plan(self) -> Plan:
        """What was computed, what was left out, and why; FileError where the file's plan is none."""
        try:
            return Plan.from_json(self._core.plan)
        except ValueError as error:
            raise FileError(f"{_MANIFEST}: {error}") from None

    @property
    def errors(self) -> dict[str, float]:
        """Relative L2 error of the picture by truncation, measured when the transport was made, by the names of lights:
        the built-in ones, and "sun", one texel. Empty in files before 0.3 and in transports that were truncated since.
        """
        return dict(self.plan.errors)

    @property
    def error(self) -> float:
        """The worst of `errors`; ValueError where there are none."""
        if not self.plan.errors:
            raise ValueError(
                "expected a transport with measured errors, but its file has none: make it anew to know them"
            )
        return max(self.plan.errors.values())

    @cached_property
    def receivers(self) -> Receivers:
        """What the rows are: `Pixels`, `Vertices` or `GatherSamples`."""
        return of_table(self._core.receivers)

    @cached_property
    def camera(self) -> Camera:
        """The camera whose pixels the rows are, or that vertices are looked at from unless another is asked; ValueError
        where the file names none, FileError where it names something else."""
        text = self._core.camera
        if text is None:
            raise ValueError("expected a transport with a camera, but its file names none")
        try:
            return Camera(**json.loads(text))
        except (ValueError, TypeError, ArithmeticError, RecursionError) as error:
            raise FileError(f"{_MANIFEST}: expected a camera: {error}") from None

    @property
    def pixels(self) -> Pixels:
        """The rows as pixels, which a picture needs; ValueError where they are something else."""
        if not isinstance(self.receivers, Pixels):
            raise ValueError(f"expected a transport of pixels for a picture, but its rows are {self.receivers.kind}")
        return self.receivers

    @cached_property
    def columns(self) -> AnyColumns:
        """The basis that V is measured in; FileError where the file's lamps are none."""
        columns = parse_any(self._core.columns)
        # Of what was made in memory only the number of lamps is known.
        if not isinstance(columns, Lamps) or self._path is None:
            return columns
        try:
            return Lamps.restored(columns.columns, self._core.beside("lamps") or {})
        except ValueError as error:
            raise FileError(f"lamps.safetensors: {error}") from None

    def coefficients(self, env: Environment, peaks: int | None = None) -> NDArray[np.float64]:
        """V: an environment in the columns of M.

        Parameters
        ----------
        env
            The light.
        peaks
            Where some columns are texels: so many suns and lamps of each map go through them, at most
            (`Environment.peaks`); None: 128.

        Returns
        -------
        (columns, 3) float64

        Raises
        ------
        ValueError
            If peaks are asked of columns without texels, or their number is negative.
        """
        if not hasattr(env, "_haar"):
            raise instead_of("Environment", env)
        columns = self.columns
        if isinstance(columns, Haar):
            return columns.coefficients(env, peaks)
        if peaks is not None:
            raise ValueError(f"expected columns with texels to send peaks through, got {columns}")
        return columns.coefficients(env)

    def image(self, B: ArrayLike, env: Environment | Sequence[Environment | None] | None = None) -> NDArray[np.float32]:
        """The picture of a response: albedos in, receivers resolved into the pixels of the transport's camera.

        Parameters
        ----------
        B
            (rows, 3): a product; or (k, rows, 3), several.
        env
            What lies behind the scene; None: black. Of several products one for all, or one for each.

        Returns
        -------
        (height, width, 3) float32
            Linear radiance, row 0 at the top; (k, height, width, 3) of several.

        Raises
        ------
        TypeError
            If an argument is something else.
        ValueError
            If the shape is wrong, the rows are neither pixels nor vertices, or the file names no camera.
        """
        if hasattr(B, "_behind"):
            raise TypeError("expected a product B, of rows and colours, before the environment behind it")
        if np.ndim(B) == 3:
            several, envs = np.asarray(B), env if isinstance(env, Sequence) else (env,) * len(np.asarray(B))
            if len(envs) != len(several):
                raise ValueError(f"expected an environment for each of {len(several)} products, got {len(envs)}")
            return np.stack([self.image(one, behind) for one, behind in zip(several, envs, strict=True)])
        if not (env is None or hasattr(env, "_behind") or isinstance(env, (list, tuple))):
            raise instead_of("Environment", env)
        if isinstance(env, Sequence):
            raise ValueError(f"expected one environment behind one product, got {len(env)}")
        if self.receivers.kind == "vertices":
            return self.render(self.camera, B, env)
        picture = self.seen(B).picture()
        if env is not None:
            env._behind(self._behind, picture)
        return picture

    def seen(self, B: ArrayLike, camera: Camera | None = None) -> Seen:
        """The samples of surfaces that pixels show of a response, for who makes pictures otherwise.

        Parameters
        ----------
        B
            (rows, 3): a product.
        camera
            Of vertices; None: that of the transport, which pixels have no other than.

        Returns
        -------
        Seen

        Raises
        ------
        ValueError
            If the shape is wrong, the rows are neither pixels nor vertices, or the file names no camera.
        """
        if camera is not None or self.receivers.kind == "vertices":
            return self._views.seen(self.camera if camera is None else camera, self._response(B))
        values = self._response(B)
        return Seen(self.pixels, values, self._glow)

    def shares(self, camera: Camera | None = None) -> Shares:
        """What pixels show of each row: the linear map from responses to pictures on black, with its transpose.

        Parameters
        ----------
        camera
            Of vertices; None: that of the transport, which pixels have no other than.

        Returns
        -------
        Shares

        Raises
        ------
        ValueError
            If the rows are neither pixels nor vertices, the file names no camera, or vertices have factors of lobes.
        """
        if camera is not None or self.receivers.kind == "vertices":
            return self._views.shares(self.camera if camera is None else camera, self.shape[0])
        return Shares(self.pixels.image_shape, self.shape[0], self.pixels, None, None)

    def _response(self, B: ArrayLike) -> NDArray[np.float32]:
        """B with the light that does not move."""
        try:
            values = np.ascontiguousarray(B, np.float32)
        except (TypeError, ValueError):
            raise TypeError(f"expected B, an array of shape ({self.shape[0]}, 3), got {described(B)}") from None
        if values.shape != (self.shape[0], 3):
            raise ValueError(f"expected B of shape ({self.shape[0]}, 3), got {values.shape}")
        return values if self.emitted is None else values + self.emitted

    @property
    def emitted(self) -> NDArray[np.float32] | None:
        """What arrives at each row of the light that surfaces give off themselves (`Material.emission`), with as many
        bounces as M has, (rows, 3); None where nothing does. It is no part of M and of B; `image`, `render` and
        `colours` add it, and what emitters themselves look like.
        """
        return None if self._emission is None else self._emission["response"]

    @cached_property
    def _emission(self) -> dict[str, NDArray[np.float32]] | None:
        arrays = self._core.beside("emission")
        for name in () if arrays is None else ("response", "radiance"):
            found = None if arrays is None else arrays.get(name)
            if found is None or found.dtype != np.float32 or found.shape != (self.shape[0], 3):
                raise FileError(f"emission.safetensors: expected {name} of float32 and shape ({self.shape[0]}, 3)")
        return arrays

    @cached_property
    def _glow(self) -> NDArray[np.float32] | None:
        """The picture of what emitters look like."""
        return None if self._emission is None else self.pixels.shown(self._emission["radiance"])

    @cached_property
    def _behind(self) -> Behind:
        return Behind(self.pixels.background, self.camera.directions())

    def render(self, camera: Camera, B: ArrayLike, env: Environment | None = None) -> NDArray[np.float32]:
        """The picture of a response at vertices as any camera sees it.

        Rays find what a pixel shows; values are mixed between the vertices around and then multiplied by the albedo of
        the point. The first rays of a camera are remembered.

        Parameters
        ----------
        camera
            Where it is looked at from.
        B
            (rows, 3): a product.
        env
            What lies behind the scene; None: black.

        Returns
        -------
        (height, width, 3) float32
            Linear radiance, row 0 at the top.

        Raises
        ------
        ValueError
            If the shape is wrong, the rows are no vertices, or the file keeps no scene.
        """
        if not isinstance(camera, Camera):
            raise instead_of("Camera", camera)
        picture = self.seen(B, camera).picture()
        if env is not None:
            env._behind(self._views.behind(camera), picture)
        return picture

    def colours(self, B: ArrayLike) -> NDArray[np.float32]:
        """The diffuse colours of vertices under a response, albedos in; what lies inside something shows its neighbour.

        Parameters
        ----------
        B
            (rows, 3): a product.

        Returns
        -------
        (vertices, 3) float32
            Linear radiance; rows of glossy factors, which only a view has a colour for, come behind those of vertices.

        Raises
        ------
        ValueError
            If the shape is wrong or the rows are no vertices.
        """
        shown = self._views.shown
        colours = self.albedo[: len(shown)] * self._response(B)[shown]
        return colours if self._emission is None else colours + self._emission["radiance"][: len(shown)]

    def save_colours(self, path: str | os.PathLike[str], B: ArrayLike, exposure: float = 0.0) -> None:
        """Writes the mesh with the colours of its vertices.

        Parameters
        ----------
        path
            A .glb, with linear colours and a material without light of its own, or a .ply, with 8-bit sRGB.
        B
            (rows, 3): a product.
        exposure
            Stops.

        Raises
        ------
        ValueError
            If the shape is wrong, the rows are no vertices, or the name ends otherwise.
        OSError
            If the disk refuses.
        """
        if not -_STOPS <= exposure <= _STOPS:
            raise ValueError(f"expected an exposure from -{_STOPS} to {_STOPS} stops, got {exposure}")
        position, normal, triangles = self.mesh()
        save_mesh(path, position, normal, triangles, np.float32(2.0**exposure) * self.colours(B))

    def mesh(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]:
        """The mesh that the rows are vertices of.

        Returns
        -------
        positions, normals : (vertices, 3) float32
            World coordinates, and unit normals; what lies inside something has that of its neighbour.
        triangles : (n, 3) uint32
            Of each side that lies open.

        Raises
        ------
        ValueError
            If the rows are no vertices.
        """
        views, receivers = self._views, self.receivers
        normal = receivers.normal[views.shown]
        return receivers.position[: len(normal)], normal, views.triangles

    @cached_property
    def surface(self) -> Surface:
        """The triangles and materials that M was computed from, as the file keeps them; ValueError where it keeps none
        (before 0.5, or from pictures), FileError where they are not those of its manifest."""
        arrays = self._core.beside("scene")
        if arrays is None:
            raise ValueError(
                "expected a transport that keeps its scene, but this one was made before 0.5, of a measured material, "
                "or from pictures"
            )
        try:
            surface = Surface.restored(arrays)
        except ValueError as error:
            raise FileError(f"scene.safetensors: {error}") from None
        if surface.digest(repr(self.camera)) != self._core.scene:
            raise FileError("scene.safetensors: expected the scene of the manifest, found another one")
        return surface

    @cached_property
    def _views(self) -> Views:
        receivers = self.receivers
        if not isinstance(receivers, Vertices):
            kind = receivers.kind
            raise ValueError(f"expected a transport of vertices for a view of one's own, but its rows are {kind}")
        arrays = self._core.beside("scene") or {}
        try:
            return Views.of(self.surface, arrays, receivers)
        except FileError:
            raise
        except ValueError as error:
            raise FileError(f"scene.safetensors: {error}") from None

    def for_camera(
        self, camera: Camera, path: str | os.PathLike[str], *, progress: bool | Progress = True
    ) -> Transport:
        """The transport of the same scene for the pixels of another camera.

        Light that arrives directly is traced for what the camera sees. Light between surfaces is not solved again: the
        nodes and their rows are taken over, and receivers are linked to them. What the first camera did not see has
        nodes where it was seen from there at second hand.

        Parameters
        ----------
        camera
            The other one.
        path
            Directory to make, as for `precompute`.
        progress
            As for `precompute`.

        Returns
        -------
        Transport
            Opened from `path`, of the same columns and quality.

        Raises
        ------
        TypeError
            If an argument is something else.
        ValueError
            If the rows are no pixels, the file keeps no scene, or the result would not fit.
        OSError
            If the disk refuses.
        """
        if not isinstance(camera, Camera):
            raise TypeError(f"expected a dl.Camera, and then a path, got {described(camera)}")
        checked_path(path)
        return made("for_camera")(self, camera, path, progress)

    def aov(self, name: str) -> NDArray[np.float32] | NDArray[np.int32]:
        """What the pixels show besides light.

        Parameters
        ----------
        name
            ``"albedo"``, as it is seen, mixed at edges; ``"normal"``, towards the camera; ``"depth"``, the distance
            from the eye; ``"position"``; ``"material"``, its number; ``"mask"``, the share of a pixel that shows a
            surface.

        Returns
        -------
        (height, width, 3) or (height, width) float32, or int32
            Row 0 at the top, in the world's axes and units. But for albedo and mask, of the surface that fills most of
            a pixel; where there is none, a normal of 0, a depth of infinity, a position of NaN, and material -1.

        Raises
        ------
        ValueError
            If there is no such layer, or the rows are not pixels.
        """
        camera = self.camera if name == "depth" else None
        return aov(self.pixels, camera, name)

    @property
    def albedo(self) -> NDArray[np.float32]:
        """What the response of every row is multiplied by, (rows, 3): diffuse reflectance, or the colour of a lobe."""
        return self.receivers.albedo

    @property
    def audit(self) -> tuple[NDArray[np.int64], Transport] | None:
        """Some rows as they were traced, untruncated: their numbers, and a transport of them; None if none were kept.

        They come in whole groups: numbers at or beyond the rows of M are padding.
        """
        found = self._core.audit()
        if found is None:
            return None
        groups, rows = found
        return (groups.astype(np.int64)[:, None] * GROUP + np.arange(GROUP)).ravel(), Transport(rows)

    def verify(self) -> list[str]:
        """Works out again what can be of what the files say: digests, structure and norms as they are on the disk now,
        norms of texel columns, losses against the audit, the scene.

        Returns
        -------
        list of str
            One sentence for each; the last says what is believed.

        Raises
        ------
        FileError
            If something is not what it is said to be.
        ValueError
            If the transport is in memory only.
        """
        return list(verified(self))

    def truncated(self, path: str | os.PathLike[str], tolerance: float) -> Transport:
        """Writes a smaller transport with a larger stated error, and opens it.

        Parameters
        ----------
        path
            Directory to make.
        tolerance
            Relative L2 error of the image that truncation may cause.

        Returns
        -------
        Transport
            Opened from `path`.

        Raises
        ------
        ValueError
            If the tolerance is out of range, or the transport has several parts.
        OSError
            If the disk refuses.
        """
        checked_path(path)
        threshold, _, _ = self._core.threshold_for(tolerance)
        # What was measured of this transport does not hold of that one.
        plan = replace(self.plan, errors={}, without={}, tolerance=tolerance, job="")
        self._core.truncate_to(path, threshold, plan=plan.to_json())
        return Transport.open(path)

    def coarsened(self, tolerance: float, width: str) -> Transport:
        """The same with a larger stated error, in memory and without receivers.

        Parameters
        ----------
        tolerance
            As for `truncated`.
        width
            Of the integers that hold its values: "i8" or "i16".

        Returns
        -------
        Transport

        Raises
        ------
        ValueError
            If an argument cannot be used, or the transport has several parts.
        """
        threshold, _, _ = self._core.threshold_for(tolerance, width=width)
        return Transport(self._core.truncated(threshold, width=width))

    def clustered(
        self,
        path: str | os.PathLike[str],
        clusters: int = 398,
        representatives: int = 25,
        progress: bool | Progress = True,
    ) -> Transport:
        """Writes a transport of two stages, in which rows that look alike share a few representatives, and opens it.

        The light is multiplied by the representatives of all clusters, and their responses by the weights that each row
        takes of those of its cluster: fewer numbers a frame, at an error of its own (`plan` says how large), which the
        bounds of frames include. Rows stand in the order of their clusters.

        Parameters
        ----------
        path
            Directory to make.
        clusters
            At most: where rows are alike, there are fewer.
        representatives
            Of each cluster, besides its mean. They are truncated to the tolerance of this transport.
        progress
            True: a bar on standard error. A callable: progress(done, total).

        Returns
        -------
        Transport
            Opened from `path`; `Relighter(second=)` says how its second stage is followed.

        Raises
        ------
        ValueError
            If an argument is out of range, or the transport has several parts, texel columns or three channels.
        OSError
            If the disk refuses.

        Notes
        -----
        Clustered principal components (Sloan 2003; Overbeck 2006, section 7.4), of rows in which columns count by the
        roots of their areas; 398 x 25 is the thesis' choice for 40,029 vertices.
        """
        build(self._core, self.plan, path, clusters, representatives, progress)
        return Transport.open(path)

    def cluster_map(self) -> NDArray[np.uint32]:
        """The clusters of a clustered transport.

        Returns
        -------
        (rows,) uint32
            The number of each row's.

        Raises
        ------
        ValueError
            If the transport is not clustered.
        """
        return self._core.labels()

    def cluster_colours(self) -> NDArray[np.float32]:
        """The clusters of a clustered transport in colours that tell neighbours apart.

        Returns
        -------
        (rows, 3) float32
            Linear RGB.

        Raises
        ------
        ValueError
            If the transport is not clustered.
        """
        return colours_of(self.cluster_map())

    def cluster_picture(self) -> NDArray[np.float32]:
        """The clusters of a clustered transport as the camera sees them.

        Returns
        -------
        (height, width, 3) float32
            Linear RGB, row 0 at the top.

        Raises
        ------
        ValueError
            If the transport is not clustered, or its rows are not pixels.
        """
        return self.pixels.shown(self.cluster_colours())

    def __repr__(self) -> str:
        rows, columns = self.shape
        return f"<Transport {rows:,} x {columns:,} ({self.columns}), {self.nbytes / 1e6:.1f} MB>"

    def _repr_html_(self) -> str:
        rows, columns = self.shape
        facts = {
            "receivers": f"{rows:,}",
            "light": f"{columns:,} columns, {self.columns}",
            "size": f"{self.nbytes / 1e6:.1f} MB",
            "file": "in memory" if self._path is None else self._path,
        }
        cells = "".join(f"<tr><th>{name}</th><td>{escape(str(fact))}</td></tr>" for name, fact in facts.items())
        return f"<table><caption>Transport</caption>{cells}</table>"


def _content(path: Path) -> str:
    """What tells one transport from another: its manifest, which knows the checksums of all other files."""
    return hashlib.blake2b(read_plain(path / _MANIFEST, MOST_TEXT), digest_size=16).hexdigest()


def _reopened(path: str, content: str) -> Transport:
    """A pickled transport, where it still is what was pickled."""
    if _content(Path(path)) != content:
        raise FileError(f"{path}: expected the transport that was pickled, found another one")
    return _kept_open(path, content)


@lru_cache(maxsize=4)
def _kept_open(path: str, content: str) -> Transport:
    """Open for the next task of a worker as well; `content` tells it from what was there before."""
    return Transport(path)
