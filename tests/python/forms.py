"""What the shared suite runs over: FORMS of storage x SPACES of columns x METHODS, each joined by one line.

A form is a transport with the dense product in float64 that it stands for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import deltalux as dl
import numpy as np
from deltalux import _core
from deltalux.surface.material import encoded

BUDGET = 16
ROWS = 40
"""Not a multiple of 16."""


class Loudest(dl.Method):
    """A method of one's own: the largest changes by what they are worth; a finest band that has drifted starts anew."""

    def choose(self, state):
        last = int(state.bands[-1])
        drifted = np.abs(state.change[state.bands == last]).sum() > np.abs(state.target[state.bands == last]).sum()
        return dl.Choice(resets=[last] if drifted else [], columns=np.argsort(-state.worth(), kind="stable"))


# A new method joins by one line.
METHODS: dict[str, dl.Method] = {
    "full": dl.Full(),
    "linear": dl.Linear(terms=BUDGET),
    "nonlinear": dl.Nonlinear(terms=BUDGET),
    "incremental": dl.Incremental(terms=BUDGET),
    "incremental-separate": dl.Incremental(terms=BUDGET, channels="separate"),
    "incremental-transport": dl.Incremental(terms=BUDGET, weight="transport"),
    "per-band": dl.PerBand(terms=BUDGET),
    "per-band-l2": dl.PerBand(terms=BUDGET, norm="l2"),
    "per-band-none": dl.PerBand(terms=BUDGET, weight="none"),
    "per-band-root-area": dl.PerBand(terms=BUDGET, weight="root-area"),
    "per-band-cost": dl.PerBand(terms=BUDGET, weight="cost"),
    "per-band-separate": dl.PerBand(terms=BUDGET, channels="separate"),
    "per-band-time": dl.PerBand(milliseconds=20.0, weight="cost"),
    "dealer": dl.PerBand(terms=BUDGET, test="dealer"),
    "dealer-time": dl.PerBand(milliseconds=20.0, test="dealer"),
    "exhaustive": dl.PerBand(terms=BUDGET, test="exhaustive"),
    "fixed": dl.PerBand(terms=BUDGET, test="fixed", fixed=1),
    "incremental-error": dl.Incremental(error=50.0),
    "per-band-error": dl.PerBand(error=50.0),
    "harmonic-order": dl.HarmonicOrder(terms=BUDGET),
    "own": Loudest(terms=BUDGET),
    "own-time": Loudest(milliseconds=20.0),
}
# These start anew in every frame, by definition, and reach the light only where their budget holds all of it.
NEVER_CONVERGE = {"linear", "nonlinear", "fixed"}
# These stop where the bound is small enough.
STOP_SHORT = {"incremental-error", "per-band-error"}
# These send as many terms as there is time for: never none while any is left.
TIMED = {"per-band-time", "dealer-time", "own-time"}

# A new space of columns joins by one line.
SPACES = {"haar:8": dl.Haar(8), "sh:8": dl.SphericalHarmonics(8)}


def dense(
    rng: np.random.Generator, columns: int, rows: int | None = None, *more: int, scale: float = 1.0
) -> np.ndarray:
    """Rows, by default ROWS, whose entries span five decades; as the float32 that a pass delivers."""
    shape = (ROWS if rows is None else rows, columns, *more)
    values = scale * rng.normal(size=shape) * 10.0 ** rng.uniform(-5, -1, (columns, *(1 for _ in more)))
    values *= rng.random(shape) < 0.5
    return values.astype(np.float32).astype(np.float64)


def stored(matrix: np.ndarray, columns: object, tile_rows: int = 32, **options) -> _core.Transport:
    return _core.Transport.from_dense(matrix, columns=str(columns), tile_rows=tile_rows, **options)


@dataclass
class Form:
    """A transport, its dense product in float64, and what a relighter over it needs besides."""

    transport: dl.Transport
    oracle: Callable[[np.ndarray], np.ndarray]
    mix: np.ndarray | None = None
    two_stages: bool = False
    options: dict = field(default_factory=dict)
    loss: float = 1.0
    """By how much more than in others truncation takes of it: budgets in error leave room for that."""

    @property
    def columns(self):
        return self.transport.columns

    @property
    def count(self) -> int:
        return self.transport.shape[1]

    def multiply(self, V: np.ndarray) -> np.ndarray:
        return self.transport.multiply(V, mix=self.mix)

    def reach(self, difference: np.ndarray) -> float:
        """How much a difference of V can change any receiver: sum over bands of the largest row times its norm."""
        mix = None if self.mix is None else self.transport.mixed(self.mix)
        starts = np.searchsorted(self.columns.bands, np.arange(int(self.columns.bands[-1]) + 1))
        norms = np.sqrt(np.add.reduceat(difference**2, starts, axis=0))
        return float((self.transport._core.error_factors(mix) @ norms).max())

    def relighter(self, method: dl.Method, initial: str | None = "full") -> dl.Relighter:
        if method.error is not None:
            method = replace(method, error=method.error * self.loss)
        return dl.Relighter(self.transport, method, initial, mix=self.mix, **self.options)


def one(columns, rng, **options) -> Form:
    M = dense(rng, columns.columns)
    return Form(dl.Transport(stored(M, columns, **options)), lambda V: M @ V)


def three_channels(columns, rng) -> Form:
    M = dense(rng, columns.columns, ROWS, 3)
    return Form(dl.Transport(stored(M, columns, width="i8")), lambda V: np.einsum("rcx,cx->rx", M, V))


def long_rows(columns, rng) -> Form:
    """Norms of 20 and more, as plain random numbers and narrow lobes have."""
    M = rng.normal(size=(ROWS, columns.columns)).astype(np.float32).astype(np.float64)
    M[:20] *= 1e-3
    return Form(dl.Transport(stored(M, columns)), lambda V: M @ V)


def factors(columns, rng) -> Form:
    Ms = [dense(rng, columns.columns) for _ in range(3)]
    mix = rng.normal(size=(ROWS, 3)).astype(np.float32)
    transport = dl.Transport(_core.Transport.join([stored(M, columns, width="i8") for M in Ms]))
    return Form(transport, lambda V: sum(mix[:, k, None] * (M @ V) for k, M in enumerate(Ms)), mix)


def nodes(columns, rng) -> Form:
    """Receivers of one channel that take from nodes of three, by weights of either sign."""
    M, N = dense(rng, columns.columns), dense(rng, columns.columns, 20, 3)
    W = rng.integers(-255, 256, (ROWS, 20)) * (rng.random((ROWS, 20)) < 0.2)
    row, node = np.nonzero(W)
    starts = np.searchsorted(row, np.arange(ROWS + 1)).astype(np.uint32)
    amounts, node = np.abs(W[row, node]).astype(np.uint16), (node | (W[row, node] < 0) << 31).astype(np.uint32)
    link = _core.Link.weights(starts, node, amounts, exponent=-8, node_count=20)
    transport = dl.Transport(_core.Transport.join([stored(M, columns), stored(N, columns, width="i8")], link))
    return Form(transport, lambda V: M @ V + W / 256 @ np.einsum("rcx,cx->rx", N, V))


def tree_matrix(areas: np.ndarray) -> np.ndarray:
    """Haar over a tree as a matrix of columns x samples, from its definition: pair by pair, coarse to fine."""
    size = 1 << (len(areas) - 1).bit_length()
    level, rows = np.diag(np.sqrt(areas)).tolist() + [[0.0] * len(areas)] * (size - len(areas)), []
    weights = [*areas, *[0.0] * (size - len(areas))]
    while len(weights) > 1:
        scaling, wavelets, sums = [], [], []
        for k in range(0, len(weights), 2):
            a0, a1 = weights[k : k + 2]
            p, q = (np.sqrt(a0 / (a0 + a1)), np.sqrt(a1 / (a0 + a1))) if a0 + a1 > 0 else (1.0, 0.0)
            x0, x1 = np.array(level[k]), np.array(level[k + 1])
            scaling.append(p * x0 + q * x1), wavelets.append(q * x0 - p * x1), sums.append(a0 + a1)
        rows, level, weights = [*wavelets, *rows], scaling, sums
    return np.array([*level, *rows])


def tree(columns, rng) -> Form:
    areas = rng.uniform(0, 2, 20) * (rng.random(20) < 0.8)
    H = tree_matrix(areas)
    L, Ts = dense(rng, columns.columns, 20), [dense(rng, len(H)) for _ in range(2)]
    mix = rng.normal(size=(ROWS, 2)).astype(np.float32)
    then = [stored(T, "tree:20") for T in Ts]
    transport = dl.Transport(_core.Transport.join([stored(L, columns)], _core.Link.tree(areas), then))
    return Form(transport, lambda V: sum(mix[:, k, None] * (T @ (H @ (L @ V))) for k, T in enumerate(Ts)), mix, True)


def representatives(columns, rng) -> Form:
    """Five clusters with a mean and three representatives each, for two factors."""
    firsts, seconds = [dense(rng, columns.columns, 20) for _ in range(2)], [dense(rng, 20, scale=10) for _ in range(2)]
    mix = rng.normal(size=(ROWS, 2)).astype(np.float32)
    pairs = list(zip(firsts, seconds, strict=True))
    kept = [(stored(P, columns), stored(W, "representatives:5x3", width="i8")) for P, W in pairs]
    norms = [norms_of_both(W @ P, *each, columns.bands) for (P, W), each in zip(pairs, kept, strict=True)]
    link = _core.Link.representatives(norms)
    transport = dl.Transport(_core.Transport.join([first for first, _ in kept], link, [then for _, then in kept]))
    return Form(transport, lambda V: sum(mix[:, k, None] * (W @ (P @ V)) for k, (P, W) in enumerate(pairs)), mix, True)


def norms_of_both(M: np.ndarray, first: _core.Transport, then: _core.Transport, bands: np.ndarray):
    """Norms in every band of the rows that two stages stand for, and of what those are off M, rounded up a little."""
    P, W = (np.concatenate([part.row(k).T for k in range(part.rows)]).astype(np.float64) for part in (first, then))
    ones = np.stack([bands == band for band in np.unique(bands)], 1)
    return tuple((1 + 1e-9) * np.sqrt(rows**2 @ ones)[..., None] for rows in (W @ P, M - W @ P))


def clustered(columns, rng) -> Form:
    """Two stages as they are built from rows, which they stand for nearly; rows are in the order of their clusters."""
    M = dense(rng, columns.columns)
    made = _core.Clusters(stored(M, columns), clusters=5, representatives=3, tolerance=0.01)
    core = _core.Transport.join([made.representatives], made.link, [made.weights])
    return Form(dl.Transport(core), lambda V: M[made.order] @ V, two_stages=True, loss=10.0)


def texels(columns, rng, glossy=False, **options) -> Form:
    """Wavelets, and texels that rows see or do not: a column by its definition, cos / pi times the root of its area, or
    of every other row a lobe, Phong's or GGX: wide ones, so that their middle speaks for a texel."""
    columns = dl.Haar(8, texels=True)
    normals = rng.normal(size=(ROWS, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    open_ = rng.random((ROWS, 384)) < 0.5
    open_[:, :100], open_[:, 200:290] = True, False
    areas, directions = texel_areas(8), texel_directions(8)
    cosines = np.maximum(normals.astype(np.float64) @ directions.T, 0)
    N = open_ * cosines / np.pi * np.sqrt(areas)
    M = dense(rng, 384)
    if glossy:
        models = [dl.brdf.Phong(1), dl.brdf.GGX(1.5, n=1.5)]
        lobe = np.where(np.arange(ROWS) % 2, np.arange(ROWS) // 2 % 2, 65535).astype(np.uint16)
        # Where an eye looks along the surface, the lobe is narrower, and the middle of a texel no longer speaks for it.
        eyes = normals + 0.5 * np.clip(rng.normal(size=(ROWS, 3)), -1, 1)
        eyes = (eyes / np.linalg.norm(eyes, axis=1, keepdims=True)).astype(np.float32)
        for row in np.flatnonzero(lobe < 2):
            wi, wo = (local(normals[row], d) for d in (directions, eyes[row]))
            N[row] = open_[row] * models[lobe[row]].evaluate(wi, wo) * cosines[row] * np.sqrt(areas)
        stored_models = encoded(models)
        lobes = [(int(k), p.tolist()) for k, p in zip(*stored_models.values(), strict=True)]
        options |= {"lobes": (lobes, lobe, eyes)}
    core = stored(M, columns, texels=(normals, open_), **options)
    return Form(dl.Transport(core), lambda V: M @ V[:384] + N @ V[384:])


def nodes_under_texels(columns, rng) -> Form:
    """Receivers with texels that take from nodes without: those get all of the light in wavelets."""
    above = texels(columns, rng)
    N = dense(rng, 384, 20, 3)
    W = (rng.integers(0, 256, (ROWS, 20)) * (rng.random((ROWS, 20)) < 0.2)).astype(np.uint16)
    row, node = np.nonzero(W)
    starts = np.searchsorted(row, np.arange(ROWS + 1)).astype(np.uint32)
    link = _core.Link.weights(starts, node.astype(np.uint32), W[row, node], exponent=-8, node_count=20)
    core = _core.Transport.join([above.transport._core, stored(N, "haar:8", width="i8")], link)
    # The wavelets of each texel, from the transform of one texel at a time.
    roots = np.sqrt(texel_areas(8))
    units = np.eye(384) / roots[:, None]
    H = np.array(
        [
            _core.haar_coefficients(8, np.repeat(u[:, None], 3, 1).reshape(6, 8, 8, 3).astype(np.float32))[:, 0]
            for u in units
        ]
    ).T
    return Form(
        dl.Transport(core),
        lambda V: above.oracle(V) + W / 256 @ np.einsum("rcx,cx->rx", N, V[:384] + H @ V[384:]),
    )


def local(normal: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Directions in the frame of Duff et al. (2017) about a unit normal."""
    x, y, z = normal.astype(np.float64)
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    frame = [[1 + sign * x * x * a, sign * x * y * a, -sign * x], [x * y * a, sign + y * y * a, -y], [x, y, z]]
    return directions @ np.array(frame).T


def texel_directions(n: int) -> np.ndarray:
    """Unit directions of texel centres, row-major, face after face: (6 n^2, 3)."""
    at = (2 * np.arange(n) + 1) / n - 1
    t, s = np.meshgrid(at, at, indexing="ij")
    one = np.ones_like(s)
    faces = [(one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one)]
    points = np.stack([np.stack(face, -1) for face in faces]).reshape(-1, 3)
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def texel_areas(n: int) -> np.ndarray:
    """Solid angles of the texels, from the antiderivative at their corners: (6 n^2,)."""
    edge = 2 * np.arange(n + 1) / n - 1
    x, y = np.meshgrid(edge, edge)
    corner = np.arctan2(x * y, np.sqrt(x * x + y * y + 1))
    return np.tile((corner[1:, 1:] + corner[:-1, :-1] - corner[1:, :-1] - corner[:-1, 1:]).ravel(), 6)


# A new form of storage joins by one line.
FORMS: dict[str, Callable[..., Form]] = {
    "i16": lambda columns, rng: one(columns, rng, width="i16"),
    "i8": lambda columns, rng: one(columns, rng, width="i8"),
    "truncated": lambda columns, rng: one(columns, rng, width="i8", threshold=0.02),
    "texels": texels,
    "texels-truncated": lambda columns, rng: texels(columns, rng, width="i8", threshold=0.02),
    "texels-glossy": lambda columns, rng: texels(columns, rng, glossy=True, width="i8"),
    "long-rows": long_rows,
    "three-channels": three_channels,
    "factors": factors,
    "nodes": nodes,
    "nodes-under-texels": nodes_under_texels,
    "tree": tree,
    "representatives": representatives,
    "clustered": clustered,
}


def build(form: str, space: str) -> Form:
    return FORMS[form](SPACES[space], np.random.default_rng(1))
