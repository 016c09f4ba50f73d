"""M as numbers: an array-like that multiplies, and scipy's linear operator."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cached_property
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from .._core import Transport as CoreTransport
from ..columns.inner import AnyColumns, parse_any
from ..mistakes import checked_path, described

if TYPE_CHECKING:
    import scipy.sparse
    import scipy.sparse.linalg

__all__ = ["Matrix"]

# In bytes that are read in the same time: choosing a column, and finding it in a tile.
_CHOOSING, _FINDING = 64.0, 300.0


class Matrix:
    """The matrix M of a transport, whatever its rows are.

    Parameters
    ----------
    core
        The transport of the core.
    """

    def __init__(self, core: CoreTransport) -> None:
        self._core = core

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self._core.shape

    @property
    def channels(self) -> int:
        """1 where one number serves all colours, as the albedo stays outside M; 3 where each colour has its own, be it
        in receivers or in nodes."""
        return self._core.channels

    @property
    def nbytes(self) -> int:
        """Bytes of M: its tiles, with the norms of their rows."""
        return self._core.nbytes

    @property
    def width(self) -> str:
        """What its values are stored in: integers of 8 bits, "i8", or of 16, "i16"."""
        return self._core.width

    @property
    def entries(self) -> int:
        """Groups of 16 rows that are stored, in all columns together."""
        return self._core.entries

    @property
    def texel_bytes(self) -> int:
        """Bytes of M that are bits of texel columns; 0 where there are none."""
        return self._core.texel_bytes

    @cached_property
    def columns(self) -> AnyColumns:
        """The basis that V is measured in."""
        return parse_any(self._core.columns)

    @cached_property
    def second_columns(self) -> AnyColumns | None:
        """What the second stage's V is measured in; None where there is one stage."""
        text = self._core.second_columns
        return None if text is None else parse_any(text)

    @overload
    def multiply(self, V: ArrayLike, *, mix: ArrayLike | None = None) -> NDArray[np.float32]: ...

    @overload
    def multiply(
        self, V: ArrayLike, *, mix: ArrayLike | None = None, dtype: type[np.float64]
    ) -> NDArray[np.float64]: ...

    def multiply(self, V: ArrayLike, *, mix: ArrayLike | None = None, dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """B = M V, the exact product in one go.

        Parameters
        ----------
        V
            (columns, 3), or (k, columns, 3) for k lights in one pass over M.
        mix
            (rows, factors): by which weights the factors' responses are added for each receiver; needed where there
            are several, and only there.
        dtype
            ``np.float32``, or ``np.float64``: of one matrix those are the exact sums.

        Returns
        -------
        (rows, 3) or (k, rows, 3) float32, or float64
            The exact product of M and V on its dyadic grid, rounded once. The albedo is not in it (see `image`).

        Raises
        ------
        TypeError
            If an argument is something else.
        ValueError
            If the shape is wrong or a coefficient is not finite.
        """
        if np.dtype(dtype) not in (np.float32, np.float64):
            raise ValueError(f"expected float32 or float64 for B, got {np.dtype(dtype)}")
        hint = "; transport.coefficients(env) makes one of a light"
        batch, single = _several("V", V, self.shape[1], hint)
        weights = None if mix is None else self.mixed(mix)
        whole = self._core.multiply if np.dtype(dtype) == np.float32 else self._core.multiply_double
        product = whole(batch, weights)
        return product[0] if single else product

    def adjoint(self, R: ArrayLike, *, mix: ArrayLike | None = None) -> NDArray[np.float64]:
        """The transpose of M times R: how much each column of the light has to do with numbers at the rows.

        It is the gradient of sum(R * B) by V, and as exact as the product: R is rounded to multiples of 2^-34 of its
        largest magnitude (what has fewer bits is taken as it is), and sums of it with values of M are exact, in any
        order and on any number of threads, and rounded once. Where V and R are whole numbers of few bits times a power
        of two, sum(multiply(V) * R) and sum(V * adjoint(R)) are the same number, bit for bit.

        Parameters
        ----------
        R
            (rows, 3), or (k, rows, 3): numbers for each receiver, of either sign.
        mix
            As for `multiply`.

        Returns
        -------
        (columns, 3) or (k, columns, 3) float64

        Raises
        ------
        TypeError
            If an argument is something else.
        ValueError
            If the shape is wrong or a number is not finite.

        Notes
        -----
        Through several matrices (nodes, clusters, trees) what goes from one to the next is rounded as R is.
        """
        batch, single = _several("R", R, self.shape[0], "")
        product = self._core.adjoint(batch, None if mix is None else self.mixed(mix))
        return product[0] if single else product

    def bounds(self, V: ArrayLike) -> NDArray[np.float64]:
        """How far whole products can be from those of untruncated transport, as `Frame.bound` says it of frames.

        Parameters
        ----------
        V
            (k, columns, 3): k lights.

        Returns
        -------
        (k,) float64
            Of each the most that any value of any row of B is off; infinite where B may be beyond float32.

        Raises
        ------
        ValueError
            If the shape is wrong, a coefficient is not finite, or the transport has two stages or several factors.
        """
        return self._core.bounds(np.ascontiguousarray(V, np.float64))

    def mixed(self, mix: ArrayLike) -> NDArray[np.float32]:
        """Weights of a mix as the core takes them.

        Parameters
        ----------
        mix
            (rows, factors), real and finite; or (factors,), for all rows.

        Returns
        -------
        (rows, factors) float32

        Raises
        ------
        ValueError
            If the shape is another.
        """
        weights = np.ascontiguousarray(mix, np.float32)
        if weights.shape == (self._core.factors,):
            # Repeated, not copied: what is alike for all rows is read once.
            return np.broadcast_to(weights, (self.shape[0], self._core.factors))
        if weights.shape != (self.shape[0], self._core.factors):
            raise ValueError(f"expected a mix of shape ({self.shape[0]}, {self._core.factors}), got {weights.shape}")
        return weights

    def row(self, i: int) -> NDArray[np.float32]:
        """One transport vector, dense and exact.

        Parameters
        ----------
        i
            Its number.

        Returns
        -------
        (columns,) float32, or (columns, 3) where each colour has its own

        Raises
        ------
        IndexError
            If there is no such row.
        ValueError
            If the transport has several parts.
        """
        if not 0 <= i < self.shape[0]:
            raise IndexError(f"expected a row of 0 or more and below {self.shape[0]}, got {i}")
        row = self._core.row(i)
        return row[:, 0] if row.shape[1] == 1 else row

    @cached_property
    def column_norms(self) -> NDArray[np.float64]:
        """The norm of every column of M: (columns,)."""
        return self._core.column_norms()

    @cached_property
    def column_bytes(self) -> NDArray[np.float64]:
        """The bytes of M that a frame streams for each column: (columns,).

        A texel's column, which holds few bytes and is made anew, counts as an entry for each group of rows that sees
        it: it takes about as long.
        """
        return self._core.column_bytes()

    @cached_property
    def column_costs(self) -> NDArray[np.float64]:
        """The time that sending each column takes, (columns,), in bytes of M that are read in the same time.

        To a column's bytes come those of choosing it, and of finding it in every tile (measured).
        """
        tiles = -(-self.shape[0] // self._core.tile_rows)
        return self.column_bytes + _CHOOSING + np.where(self.column_bytes > 0, _FINDING * tiles, 0.0)

    def to_scipy(self, channel: int = 0) -> scipy.sparse.csr_matrix:
        """A copy of M as a scipy CSR matrix of float32.

        Parameters
        ----------
        channel
            Which colour, where each has its own: 0, 1 or 2.

        Returns
        -------
        scipy.sparse.csr_matrix
            (rows, columns), without the zeros that groups of rows hold.

        Raises
        ------
        IndexError
            If there is no such channel.
        ValueError
            If the transport has several parts.
        """
        import scipy.sparse

        if not 0 <= channel < self.channels:
            raise IndexError(f"expected a channel from 0 to {self.channels - 1}, got {channel}")
        indptr, indices, data = self._core.to_csr(channel)
        return scipy.sparse.csr_matrix((data, indices, indptr), shape=self.shape)

    def to_zarr(self, path: str | os.PathLike[str]) -> None:
        """Writes a copy of M for other programs: a group in zarr's format, version 3.

        For each channel it has the arrays of scipy's CSR, ``indptr``, ``indices`` and ``data``, in a group of the
        channel's number; attributes say ``shape``, ``channels`` and ``columns``.

        Parameters
        ----------
        path
            Directory to make, by custom ``NAME.zarr``.

        Raises
        ------
        ValueError
            If zarr is missing, or the transport has several parts.
        FileExistsError
            If something is there.
        """
        if find_spec("zarr") is None:
            raise ValueError("expected zarr to write one: pip install 'deltalux[arrays]'")
        import zarr

        checked_path(path)
        if os.path.exists(path):
            raise FileExistsError(f"{os.fspath(path)}: expected nothing there, as a copy is never written over")
        copies = [self._core.to_csr(channel) for channel in range(self.channels)]
        group = zarr.open_group(os.fspath(path), mode="w-", zarr_format=3)
        group.attrs.update({"shape": list(self.shape), "channels": self.channels, "columns": str(self.columns)})
        for channel, arrays in enumerate(copies):
            own = group.create_group(str(channel))
            for name, array in zip(("indptr", "indices", "data"), arrays, strict=True):
                own.create_array(name, data=np.asarray(array))

    # What scipy asks of a linear operator: `scipy.sparse.linalg.aslinearoperator(transport)` takes these.
    dtype = np.dtype(np.float64)

    def matmat(self, x: ArrayLike) -> NDArray[np.float64]:
        """M x, as scipy asks it.

        Parameters
        ----------
        x
            (columns,) or (columns, k), real.

        Returns
        -------
        (rows,) or (rows, k) float64

        Raises
        ------
        ValueError
            If each colour has an M of its own.
        """
        return self._in_threes(self._core.multiply_double, x, self.shape[1])

    def _in_threes(
        self, product: Callable[[NDArray[np.float64]], NDArray[np.float64]], x: ArrayLike, length: int
    ) -> NDArray[np.float64]:
        """Columns of an array, each multiplied: the kernels take three colours at a time."""
        self._check_one_channel()
        columns = np.asarray(x, np.float64).reshape(length, -1).T
        padded = np.zeros((-(-len(columns) // 3) * 3, length))
        padded[: len(columns)] = columns
        out = product(np.ascontiguousarray(padded.reshape(-1, 3, length).swapaxes(1, 2))).swapaxes(1, 2)
        return np.ascontiguousarray(out.reshape(-1, out.shape[2])[: len(columns)].T).reshape((-1, *np.shape(x)[1:]))

    def _check_one_channel(self) -> None:
        if self.channels != 1:
            raise ValueError("expected a transport of one channel; take `to_scipy(channel)`, or `multiply` for colours")

    def rmatmat(self, y: ArrayLike) -> NDArray[np.float64]:
        """The transpose of M times y, as scipy asks it.

        Parameters
        ----------
        y
            (rows,) or (rows, k), real.

        Returns
        -------
        (columns,) or (columns, k) float64

        Raises
        ------
        ValueError
            If each colour has an M of its own.
        """
        return self._in_threes(self._core.adjoint, y, self.shape[0])

    matvec, rmatvec = matmat, rmatmat

    def linear_operator(self) -> scipy.sparse.linalg.LinearOperator:
        """M and its transpose as an operator.

        Returns
        -------
        scipy.sparse.linalg.LinearOperator
            (rows, columns), float64.
        """
        import scipy.sparse.linalg

        return scipy.sparse.linalg.aslinearoperator(self)


def _several(name: str, array: ArrayLike, length: int, hint: str) -> tuple[NDArray[np.float64], bool]:
    """An array of triples, or several, as several; and whether it was one."""
    try:
        found = np.ascontiguousarray(array, np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"expected {name}, an array of shape ({length}, 3), got {described(array)}{hint}") from None
    batch = found[None] if found.ndim == 2 else found
    if batch.ndim != 3 or batch.shape[1:] != (length, 3):
        raise ValueError(f"expected {name} of shape ({length}, 3) or (k, {length}, 3), got {np.shape(array)}")
    return batch, found.ndim == 2
