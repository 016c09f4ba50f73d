"""Budgets in milliseconds, kept or not: `python benches/deadline.py plant.transport`.

A light turns by 0.45 degrees a frame. For each budget, method and number of threads: the share of the budget that a
frame takes (median, 95th percentile and slowest), what it sends, and the error that it leaves: the relative L1 of the
image against the whole product, of one frame in ten. `fixed` is a frame that sends nothing: no budget below it can be
kept. Frames are in blocks that take turns, so that what else the machine does meets all of them.
"""

from __future__ import annotations

import argparse
import time

import deltalux as dl
import numpy as np

METHODS = {
    "NWA, transport": lambda ms: dl.Nonlinear(milliseconds=ms, weight="transport"),
    "BI, transport": lambda ms: dl.Incremental(milliseconds=ms, weight="transport"),
    "PBI, transport": lambda ms: dl.PerBand(milliseconds=ms, weight="transport"),
    "PBI, cost": lambda ms: dl.PerBand(milliseconds=ms, weight="cost"),
}
# Frames of a block, and those at its start that are not counted: a relighter learns its pace in them.
BLOCK, LEARNING = 100, 25


def block(relighter, env, first, whole):
    """Seconds, terms, resets and errors of the frames from `first` on."""
    seconds, terms, resets, errors = [], [], [], []
    for k in range(BLOCK):
        frame = relighter.step(env.rotated(0.45 * (first + k)))
        if first + k < LEARNING:
            continue
        seconds.append(frame.seconds)
        terms.append(len(frame.columns))
        resets.append(len(frame.resets))
        if k % 10 == 0:
            exact = whole(first + k)
            errors.append(np.abs(frame.values - exact).sum() / np.abs(exact).sum())
            # The whole product has emptied the caches: two frames that are not counted fill them again.
            for _ in range(2):
                relighter.step(env.rotated(0.45 * (first + k)))
    return seconds, terms, resets, errors


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("transport")
    parser.add_argument("--env", nargs="+", default=["hall", "sky"])
    parser.add_argument("--budgets", nargs="+", type=float, default=[1.0, 2.0, 4.0], help="milliseconds")
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--blocks", type=int, default=4)
    args = parser.parse_args()

    transport = dl.Transport.open(args.transport)
    print(transport)
    print(f"{'':46}{'of the budget':>24}{'terms':>7}{'resets':>8}{'error':>9}")
    print(f"{'light':8}{'threads':>8}{'budget':>10}  {'method':18}{'p50':>8}{'p95':>8}{'slowest':>8}")
    for name in args.env:
        env = dl.Environment.load(name) if "." in name else dl.Environment.builtin(name)

        def whole(k, env=env):
            return transport.multiply(transport.coefficients(env.rotated(0.45 * k)))

        for threads in args.threads:
            dl.set_threads(threads)
            fixed = dl.Relighter(transport, dl.PerBand(terms=0))
            rows = {("fixed", None): fixed}
            rows |= {(m, ms): dl.Relighter(transport, METHODS[m](ms)) for ms in args.budgets for m in METHODS}
            seen = {row: [[], [], [], []] for row in rows}
            for number in range(args.blocks):
                for row, relighter in rows.items():
                    for total, part in zip(seen[row], block(relighter, env, BLOCK * number, whole), strict=True):
                        total += part
                time.sleep(0.05)
            for (method, ms), (seconds, terms, resets, errors) in seen.items():
                times = np.quantile(seconds, [0.5, 0.95, 1.0]) * 1e3
                shares = "".join(f"{t:8.2f}" if ms is None else f"{t / ms:7.0%} " for t in times)
                budget = "" if ms is None else f"{ms:g} ms"
                print(
                    f"{name:8}{threads:8}{budget:>10}  {method:18}{shares}{np.median(terms):7.0f}"
                    f"{np.mean(resets):8.2f}{np.mean(errors):9.2%}"
                )


if __name__ == "__main__":
    main()
