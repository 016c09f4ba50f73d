"""What pages may ask for, one function each."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import one_of
from ..io import TONES, save_image, to_display
from .client import Client
from .messages import checked_keys, number
from .relit import Relit
from .stage import Stage
from .subject import halves

__all__ = ["SESSION", "Requests", "read_session", "resume", "session_of"]

SESSION = "deltalux view 1"
_MEDIA = {"png": "image/png", "exr": "image/x-exr", "session": "application/json"}


class Requests:
    """The vocabulary of pages.

    Parameters
    ----------
    stage
        What is played.
    tell
        Says something to all pages.
    """

    def __init__(self, stage: Stage, tell: Callable[[Mapping[str, Any]], None]) -> None:
        self._stage, self._tell = stage, tell
        self._known: dict[str, Callable[[Client, Any], dict[str, Any] | None]] = {
            "state": lambda client, value: stage.take(_object(value)),
            "paint": lambda client, value: self._paint(client, "paint", value),
            "unpaint": lambda client, value: self._paint(client, "unpaint", value),
            "step": lambda client, value: stage.step_once(),
            "want": lambda client, value: client.want(value),
            "ack": lambda client, value: client.acknowledge(value),
            "look": self._look,
            "curve": self._curve,
            "save": self._save,
            "open": self._open,
        }

    def do(self, client: Client, kind: str, value: Any) -> dict[str, Any] | None:
        """What a page asks for; gives back what of the state was set by it, which others are told."""
        if kind not in self._known:
            raise ValueError(f"expected a message of {', '.join(self._known)}, got {kind[:40]!r}")
        return self._known[kind](client, value)

    def _paint(self, client: Client, change: str, value: Any) -> None:
        subject = self._stage.subject
        if not isinstance(subject, Relit):
            raise ValueError("expected a transport whose light is painted")
        subject.paint(change, value)
        self._stage.wake()
        if change == "unpaint":
            # The page that asked for it hears it too: it does not know how many dabs there are.
            self._tell({"state": {"light": subject.lights.to_json()}, "by": client.number})

    def _look(self, client: Client, value: Any) -> None:
        if not isinstance(value, list) or len(value) != 2 or not all(isinstance(own, int) for own in value):
            raise ValueError("expected a pixel to look at as two whole numbers")
        row, rows = self._stage.subject.look(*value)
        words = {"name": "row", "type": "f16", "size": row.shape[1]}
        client.answer({"kind": "row", "x": value[0], "y": value[1], "rows": rows}, [(words, halves(row))])

    def _curve(self, client: Client, value: Any) -> None:
        curve = getattr(self._stage.subject, "curve", None)
        if curve is None:
            raise ValueError("expected a transport of curves")
        client.say({"curve": curve(value)})

    def _save(self, client: Client, value: Any) -> None:
        found = checked_keys("what is saved", value, ("kind", "exposure", "tone", "view"))
        kind, tone = str(found.get("kind")), found.get("tone", "srgb")
        one_of("what is saved", kind, ("png", "exr", "session", "python", "command"))
        exposure = number("an exposure", found.get("exposure", 0.0), -64.0, 64.0)
        tone = tone if tone in TONES else "srgb"
        view = {"exposure": exposure, "tone": tone}
        subject = self._stage.subject
        if kind in ("python", "command"):
            made = subject.python(view) if kind == "python" else subject.command(view)
            client.say({"text": {"kind": kind, "text": made}})
            return
        if kind == "session":
            data = json.dumps(session_of(self._stage, _object(found.get("view", {}))), indent=1).encode()
        else:
            picture = subject.picture(self._stage.fresh())
            data = _file(picture if kind == "exr" else to_display(picture, exposure, tone), kind)
        name = f"view.{'json' if kind == 'session' else kind}"
        client.answer({"kind": "file", "name": name, "media": _MEDIA[kind]}, [({"name": "file"}, data)])

    def _open(self, client: Client, value: Any) -> None:
        state, view = resume(self._stage, value)
        client.say({"view": view})
        self._tell({"state": state, "by": 0})


def _object(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"expected an object, got {str(value)[:40]}")
    return value


def _file(picture: NDArray[Any], kind: str) -> bytes:
    """The bytes of a picture as the package writes it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"view.{kind}"
        save_image(path, picture if kind == "png" else np.asarray(picture, np.float32), {"software": "deltalux"})
        return path.read_bytes()


def session_of(stage: Stage, view: Mapping[str, Any]) -> dict[str, Any]:
    """All that is set, to be opened again."""
    subject = stage.subject
    words: dict[str, Any] = {"format": SESSION, "kind": subject.kind, "state": stage.state(), "view": view}
    if isinstance(subject, Relit):
        words["dabs"] = {name: [list(dab) for dab in dabs] for name, dabs in subject.lights.dabs.items()}
    return words


def read_session(path: Path) -> dict[str, Any]:
    """A session's file; ValueError where it is none."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        raise ValueError(f"{path}: expected a session that the view has saved") from None
    if not isinstance(found, dict) or found.get("format") != SESSION:
        raise ValueError(f"{path}: expected a session that the view has saved")
    return found


def resume(stage: Stage, value: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Sets all that a session holds; gives back the state, and what the page kept in it."""
    found = _object(value)
    if found.get("format") != SESSION:
        raise ValueError("expected a session that the view has saved")
    if found.get("kind") != stage.subject.kind:
        raise ValueError(f"expected a session of {stage.subject.kind}, got one of {str(found.get('kind'))[:20]}")
    stage.take(_object(found.get("state")))
    subject, dabs = stage.subject, found.get("dabs")
    if isinstance(subject, Relit) and isinstance(dabs, dict):
        subject.lights = replace(subject.lights, dabs={})
        for name, own in dabs.items():
            for dab in own if isinstance(own, list) else ():
                if not isinstance(dab, list) or len(dab) != 4:
                    raise ValueError("expected dabs of an azimuth, an elevation, a radius and a colour")
                subject.paint("paint", {"id": name, "points": [dab[:2]], "radius": dab[2], "colour": dab[3]})
        stage.wake()
    return stage.state(), _object(found.get("view", {}))
