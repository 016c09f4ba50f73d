"""Products and frames, side by side with scipy and MKL in one run: `python benches/peers_products.py plant.transport`.

Times are wall-clock milliseconds, best and median of several, after one warm-up. A peer multiplies the same stored
matrix as float32; its frame is `csc[:, columns] @ change` with the columns that ours has just chosen. MKL is measured
where the package `sparse_dot_mkl` is installed.
"""

from __future__ import annotations

import argparse
import time

import deltalux as dl
import numpy as np


def timed(work, repeats):
    """Best and median milliseconds of some calls."""
    work()
    taken = []
    for _ in range(repeats):
        started = time.perf_counter()
        work()
        taken.append(1e3 * (time.perf_counter() - started))
    return min(taken), float(np.median(taken))


def frames(transport, method, lights):
    """Per-frame milliseconds of choosing and of multiplying, and the columns that were sent."""
    relighter = dl.Relighter(transport, method)
    done = []
    for V in lights:
        # A frame that is kept takes fresh memory for the next one, which is no part of the method.
        frame = relighter.step(V)
        done.append((1e3 * frame.choosing, 1e3 * frame.multiplying, frame.columns))
    # The first frames are the whole product and the reset of what it put in.
    return zip(*done[len(done) // 5 :], strict=True)


def row(name, best, median, note=""):
    print(f"{name:<44}{best:9.2f}{median:9.2f}  {note}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("transport")
    parser.add_argument("--env", default="hall")
    parser.add_argument("--frames", type=int, default=100)
    args = parser.parse_args()

    transport = dl.Transport.open(args.transport)
    env = dl.Environment.load(args.env) if "." in args.env else dl.Environment.builtin(args.env)
    lights = [transport.coefficients(env.rotated(0.45 * k)) for k in range(args.frames)]
    csr = transport.to_scipy()
    csc = csr.tocsc()
    V = lights[0].astype(np.float32)
    print(f"{transport}, {csr.nnz:,} values; {dl.threads()} threads; milliseconds, best and median")

    row("whole product, deltalux", *timed(lambda: transport.multiply(lights[0]), 8), "exact")
    row("whole product, scipy CSR", *timed(lambda: csr @ V, 3), "float32, 1 thread")
    try:
        from sparse_dot_mkl import dot_product_mkl

        row("whole product, MKL CSR", *timed(lambda: dot_product_mkl(csr, V), 8), "float32")
    except ImportError:
        print("whole product, MKL CSR: sparse_dot_mkl is not installed")

    row("light to coefficients", *timed(lambda: transport.coefficients(env.rotated(12.3)), 20))
    for threads in (1, 2):
        dl.set_threads(threads)
        for name, method in [
            ("PBI-30", dl.PerBand(terms=30)),
            ("NWA-30", dl.Nonlinear(terms=30)),
            ("NWA-100", dl.Nonlinear(terms=100)),
        ]:
            choosing, multiplying, columns = frames(transport, method, lights)
            note = f"p95 {np.quantile(multiplying, 0.95):.2f}; tests and selection {np.median(choosing):.2f}"
            row(f"{name} frame, multiplying, {threads} threads", min(multiplying), np.median(multiplying), note)
            if threads == 1 and name == "PBI-30":
                chosen = columns[len(columns) // 2].astype(np.int64)
                change = np.ones((len(chosen), 3), np.float32)
                row("the same columns, scipy CSC", *timed(lambda c=chosen, d=change: csc[:, c] @ d, 5), "1 thread")
    relighter = dl.Relighter(transport, dl.PerBand(terms=30))
    for V in lights[:3]:
        relighter.step(V)
    print(f"memory beyond M: {relighter.nbytes:,} bytes (the papers: 19,169,280 at 512 x 512)")


if __name__ == "__main__":
    main()
