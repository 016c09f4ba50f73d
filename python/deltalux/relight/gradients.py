"""M for what learns: the product as a function that knows its own gradient, with neither torch nor JAX needed here.

The product is linear: its gradient by V is the transpose, `Transport.adjoint`, whatever V is. `Response` and `Picture`
are the function and its transpose in numpy; `torch` and `jax` make of either a function for those.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera import Camera
from ..mistakes import instead_of
from ..transport.transport import Transport

__all__ = ["Picture", "Response", "jax", "torch"]


class _Linear(Protocol):
    """A linear function of V, and its transpose."""

    shape: tuple[int, ...]

    def forward(self, V: ArrayLike) -> NDArray[np.float64]:
        """What V, (columns, 3), gives."""
        raise NotImplementedError

    def backward(self, numbers: ArrayLike) -> NDArray[np.float64]:
        """The gradient by V, (columns, 3), of the sum of numbers times what V gives."""
        raise NotImplementedError


class Response:
    """B = M V in 64 bits, (rows, 3).

    Parameters
    ----------
    transport
        M.
    mix
        As for `Transport.multiply`.

    Attributes
    ----------
    columns : int
        The length of V.
    shape : tuple
        Of what it gives.

    Raises
    ------
    TypeError
        If it is no transport.
    """

    def __init__(self, transport: Transport, mix: ArrayLike | None = None) -> None:
        if not isinstance(transport, Transport):
            raise instead_of("Transport", transport)
        self._transport, self._mix = transport, mix
        self.columns, self.shape = transport.shape[1], (transport.shape[0], 3)

    def forward(self, V: ArrayLike) -> NDArray[np.float64]:
        """M V.

        Parameters
        ----------
        V
            (columns, 3)

        Returns
        -------
        (rows, 3) float64

        Raises
        ------
        ValueError
            As for `Transport.multiply`.
        """
        return self._transport.multiply(V, mix=self._mix, dtype=np.float64)

    def backward(self, numbers: ArrayLike) -> NDArray[np.float64]:
        """The transpose of M times numbers.

        Parameters
        ----------
        numbers
            (rows, 3)

        Returns
        -------
        (columns, 3) float64

        Raises
        ------
        ValueError
            As for `Transport.adjoint`.
        """
        return self._transport.adjoint(numbers, mix=self._mix)


class Picture:
    """The picture of V on black, (height, width, 3), without what surfaces give off themselves.

    Parameters
    ----------
    transport
        M, of pixels or vertices.
    camera
        Of vertices; None: that of the transport.

    Attributes
    ----------
    columns : int
        The length of V.
    shape : tuple
        Of what it gives.

    Raises
    ------
    TypeError
        If it is no transport.
    ValueError
        As for `Transport.shares`.
    """

    def __init__(self, transport: Transport, camera: Camera | None = None) -> None:
        self._response = Response(transport)
        self._shares = transport.shares(camera)
        self.columns, self.shape = self._response.columns, (*self._shares.image_shape, 3)

    def forward(self, V: ArrayLike) -> NDArray[np.float64]:
        """The picture.

        Parameters
        ----------
        V
            (columns, 3)

        Returns
        -------
        (height, width, 3) float64

        Raises
        ------
        ValueError
            As for `Transport.multiply`.
        """
        return self._shares.picture(self._response.forward(V))

    def backward(self, numbers: ArrayLike) -> NDArray[np.float64]:
        """The transpose.

        Parameters
        ----------
        numbers
            (height, width, 3)

        Returns
        -------
        (columns, 3) float64

        Raises
        ------
        ValueError
            If a number is not finite.
        """
        return self._response.backward(self._shares.back(np.asarray(numbers, np.float64)))


def torch(linear: _Linear) -> Callable[[Any], Any]:
    """A function of torch tensors that backpropagates.

    Parameters
    ----------
    linear
        `Response`, `Picture`, or another with `forward` and `backward`.

    Returns
    -------
    callable
        From V, a tensor (columns, 3), to a tensor of the same type and device. Computed on the processor.

    Raises
    ------
    ModuleNotFoundError
        If torch is not installed.
    """
    library: Any = importlib.import_module("torch")

    def through(map_: Callable[[ArrayLike], NDArray[np.float64]], tensor: Any) -> Any:
        found = map_(tensor.detach().cpu().numpy())
        return library.from_numpy(found).to(dtype=tensor.dtype, device=tensor.device)

    def ahead(context: Any, V: Any) -> Any:
        return through(linear.forward, V)

    def back(context: Any, numbers: Any) -> Any:
        return through(linear.backward, numbers)

    # Made here, as its base is torch's.
    once = library.autograd.function.once_differentiable(back)
    parts = {"forward": staticmethod(ahead), "backward": staticmethod(once)}
    function: Any = type("Linear", (library.autograd.Function,), parts)
    applied: Callable[[Any], Any] = function.apply
    return applied


def jax(linear: _Linear) -> Callable[[Any], Any]:
    """A function of JAX arrays that has a gradient, under `jit` too.

    Parameters
    ----------
    linear
        `Response`, `Picture`, or another with `forward`, `backward` and `shape`.

    Returns
    -------
    callable
        From V, an array (columns, 3), to an array of the same type. Computed on the processor, by a callback.

    Raises
    ------
    ModuleNotFoundError
        If JAX is not installed.
    """
    library: Any = importlib.import_module("jax")

    def called(map_: Callable[[ArrayLike], NDArray[np.float64]], array: Any, shape: tuple[int, ...]) -> Any:
        result = library.ShapeDtypeStruct(shape, array.dtype)
        found = lambda x: map_(np.asarray(x)).astype(array.dtype)  # noqa: E731, it is what is called back
        return library.pure_callback(found, result, array, vmap_method="sequential")

    def product(V: Any) -> Any:
        return called(linear.forward, V, linear.shape)

    function = library.custom_vjp(product)

    def ahead(V: Any) -> tuple[Any, Any]:
        return function(V), V

    def back(V: Any, numbers: Any) -> tuple[Any]:
        return (called(linear.backward, numbers, V.shape),)

    function.defvjp(ahead, back)
    made: Callable[[Any], Any] = function
    return made
