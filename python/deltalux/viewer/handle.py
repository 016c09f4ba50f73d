"""`dl.view`: a transport under a light that is moved by hand, in a browser."""

from __future__ import annotations

import base64
import os
import threading
import webbrowser
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from .._core import __version__
from ..images.encoded import encoded
from ..io import auto_exposure, to_display, write
from ..light.environment import Environment
from ..light.skies import BUILTIN
from ..mistakes import instead_of
from ..relight.relighter import Frame
from ..scene.scene import Scene
from ..sphere import latlong_directions
from ..transport.curves import FOLDER as CURVES
from ..transport.curves import CurveTransport
from ..transport.studio import FOLDER as STUDIO
from ..transport.studio import StudioTransport
from ..transport.transport import Transport
from ..update.methods import Method, PerBand
from .curved import Curved
from .lights import Group, Lights
from .preview import Refinement, small
from .relit import Relit
from .requests import Requests
from .server import DEFAULT_PORT, Server, check_installed
from .stage import Stage
from .staged import Staged
from .subject import Subject

__all__ = ["View", "lights_of", "opened", "subject_of", "view"]

_THUMB = (32, 64)


def view(
    transport: Transport | CurveTransport | StudioTransport | Scene | str | os.PathLike[str],
    env: Environment | Sequence[Environment] | None = None,
    *,
    method: Method | None = None,
    own: Sequence[type[Method]] = (),
    port: int | None = None,
    browser: bool = True,
) -> View:
    """Shows a transport in the browser, under a light that is moved by hand.

    The page is served on this machine alone, to whoever knows the address with its token. In a notebook the view shows
    itself.

    Parameters
    ----------
    transport
        Of pixels or of vertices, whose light moves; of curves or of a studio, whose materials and lamps do; or the path
        of one. Or a scene: a small transport of it is made in seconds and shown, and finer ones in its place while one
        plays.
    env
        The light to begin with, or several to choose from, of which the first is shown; the built-in ones are always
        there. None: the built-in hall.
    method
        How what moves is followed; None: `PerBand` of 30 terms, and for curves and studios what they do by themselves.
    own
        Methods of one's own, as classes, to choose from besides.
    port
        None: 8765, or another where that is taken.
    browser
        Whether to open one.

    Returns
    -------
    View
        It plays until it is closed.

    Raises
    ------
    TypeError, ValueError, OSError
        If an argument cannot be used, or the port is taken.
    ModuleNotFoundError
        If the package `websockets` is not installed (``pip install 'deltalux[view]'``).
    """
    check_installed()
    scene = transport if isinstance(transport, Scene) else None
    found = opened(transport) if isinstance(transport, (str, os.PathLike)) else transport
    given = [] if env is None else [env] if isinstance(env, Environment) else list(env)
    for one in given:
        if not isinstance(one, Environment):
            raise instead_of("Environment", one)
    if given and not isinstance(found, (Transport, Scene)):
        raise ValueError("expected env= with a transport whose light moves: here materials and lamps do")
    lights, methods = lights_of(given, {}), {one.__name__.lower(): one for one in own}
    seen = small(found, progress=True) if isinstance(found, Scene) else found
    subject = subject_of(seen, lights, method, methods, None)
    shown = View(subject, Path(subject.name).name if scene is None else scene.name, port=port)
    if scene is not None:
        shown.refine(scene)
    if browser:
        webbrowser.open(shown.url)
    return shown


Shown = Transport | CurveTransport | StudioTransport


def opened(path: str | os.PathLike[str]) -> Shown:
    """Whatever of the three a directory holds."""
    if (Path(path) / CURVES.manifest).exists():
        return CurveTransport.open(path)
    return StudioTransport.open(path) if (Path(path) / STUDIO.manifest).exists() else Transport(path)


def subject_of(
    transport: Shown, lights: Lights, method: Method | None, own: Mapping[str, type[Method]], name: str | None
) -> Relit | Curved | Staged:
    """A transport as a view shows it; `name` is what programs call it by."""
    if isinstance(transport, CurveTransport):
        return Curved(transport, "auto" if method is None else method, name or str(transport.path))
    if isinstance(transport, StudioTransport):
        return Staged(transport, method, name or str(transport.path))
    if not isinstance(transport, Transport):
        raise instead_of("Transport", transport)
    followed = PerBand(terms=30) if method is None else method
    return Relit(transport, lights, followed, own, name or str(transport._path or "scene.transport"))


def lights_of(given: Sequence[Environment], paths: Mapping[str, str]) -> Lights:
    """The first of some environments, and the built-in ones to choose from besides."""
    sources: dict[str, Environment] = {}
    for env in given:
        name, again = env.name, 1
        while name in sources:
            again += 1
            name = f"{env.name} {again}"
        sources[name] = env
    first = next(iter(sources), "hall")
    for name in BUILTIN:
        sources.setdefault(name, Environment.builtin(name))
    return Lights(sources, (Group("light", "environment", source=first),), paths=paths)


class View:
    """A view that is open; `dl.view` makes it.

    It may be used from the program that made it while others look at it in a browser.

    Parameters
    ----------
    subject
        What is shown.
    title
        Of the page.
    host
        Where it listens: this machine's own address, or, for others to reach it, one that they know it by.
    port
        None: 8765, or another where that is taken.

    Attributes
    ----------
    url
        The address, with the token that lets a page in.

    Raises
    ------
    ModuleNotFoundError
        If the package `websockets` is not installed.
    OSError
        If the port is taken.
    """

    def __init__(self, subject: Subject, title: str, *, host: str = "127.0.0.1", port: int | None = None) -> None:
        self._title = title
        self._stage = Stage(subject)
        self._closing = threading.Lock()
        self._refinement: Refinement | None = None
        self._thumbs: dict[str, str] = {}
        requests = Requests(self._stage, lambda words: self._server.say(words))
        try:
            self._server = Server(self._stage, requests, self._welcome, host, DEFAULT_PORT if port is None else port)
        except OSError:
            if port is not None:
                raise
            self._server = Server(self._stage, requests, self._welcome, host, 0)
        self.url = self._server.url
        self._stage.start(lambda text: self._server.say({"problem": text}))
        self._server.start()

    @property
    def _relit(self) -> Relit:
        if not isinstance(self._stage.subject, Relit):
            raise ValueError("expected a view of a transport under a light that moves")
        return self._stage.subject

    @property
    def env(self) -> Environment:
        """The light as it is set. An environment that is assigned takes the place of all groups of light."""
        return self._relit.lights.environment

    @env.setter
    def env(self, env: Environment) -> None:
        if not isinstance(env, Environment):
            raise instead_of("Environment", env)
        lights = self._relit.lights
        name = env.name if lights.sources.get(env.name, env) is env else f"{env.name} *"
        self._thumbs.pop(name, None)
        lights = replace(lights, sources={**lights.sources, name: env}, groups=(), blend=(None, 0.0), dabs={})
        self._relit.lights = replace(lights, groups=(Group("light", "environment", source=name),))
        self._told("light")

    @property
    def method(self) -> Method:
        """How the light is followed; another may be assigned."""
        return self._relit.method

    @method.setter
    def method(self, method: Method) -> None:
        if not isinstance(method, Method):
            raise ValueError(f"expected an update method such as dl.PerBand(terms=30), got {method!r}")
        self._relit.method = method
        self._told("method")

    def _told(self, key: str) -> None:
        self._stage.wake()
        self._server.say({"state": {key: self._stage.state()[key]}, "by": 0})
        if key == "light":
            self._server.say({"sources": self._sources()})

    @property
    def frame(self) -> Frame:
        """The next frame that is shown of what is set now."""
        shown = self._stage.fresh().of
        return shown.a  # type: ignore[no-any-return]

    def snapshot(self, path: str | os.PathLike[str], *, exposure: float | None = None, tone: str = "srgb") -> None:
        """Writes the picture that is shown.

        Parameters
        ----------
        path
            ``.exr`` or ``.hdr`` for linear radiance, ``.png`` for 8 bits a colour.
        exposure
            Stops, in a PNG; None: chosen by the picture.
        tone
            The curve of a PNG: ``"srgb"`` or ``"agx"``.

        Raises
        ------
        ValueError
            Another format or tone.
        OSError
            The file cannot be written.
        """
        picture = self._stage.subject.picture(self._stage.fresh())
        write(path, picture, exposure=auto_exposure(picture) if exposure is None else exposure, tone=tone)

    def refine(self, scene: Scene, output: Path | None = None) -> None:
        """Shows finer transports of the scene, one after the other, as they are made.

        Parameters
        ----------
        scene
            That is shown.
        output
            Where the finest one goes; None: it goes with the view.

        Raises
        ------
        ValueError
            If a material is measured.
        """

        def made(transport: Transport) -> None:
            relit = self._relit
            self._stage.replace(relit.finer(transport, str(transport._path)))
            self._server.say({"progress": None})

        def progress(what: str, share: float) -> None:
            self._server.say({"progress": {"what": what, "share": share}})

        self._refinement = Refinement(scene, output, made, progress)

    def close(self) -> None:
        """Ends the view: pages are told, and the port is free. Closing it again does nothing."""
        with self._closing:
            if self._refinement is not None:
                self._refinement.end()
                self._refinement = None
            if not self._stage.ended:
                self._stage.end()
                self._server.end()

    def __enter__(self) -> View:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<View of {self._title}, {'closed' if self._stage.ended else self.url}>"

    def _repr_html_(self) -> str:
        if self._stage.ended:
            return "<p>This view is closed.</p>"
        return f'<iframe src="{self.url}" width="100%" height="640" style="border: 0"></iframe>'

    def _welcome(self) -> dict[str, Any]:
        return {
            "title": self._title,
            "version": __version__,
            **self._stage.subject.about(),
            "sources": self._sources(),
            "state": self._stage.state(),
        }

    def _sources(self) -> list[dict[str, str]]:
        subject = self._stage.subject
        if not isinstance(subject, Relit):
            return []
        for name, env in subject.lights.sources.items():
            if name not in self._thumbs:
                self._thumbs[name] = _thumb(env)
        return [{"name": name, "thumb": self._thumbs[name]} for name in subject.lights.sources]


def _thumb(env: Environment) -> str:
    """A small picture of an environment, as an address."""
    picture = env.radiance(latlong_directions(*_THUMB))
    data = encoded(to_display(picture, auto_exposure(picture)))
    return "data:image/png;base64," + base64.b64encode(data).decode()
