"""The errors of images, and their curves over time, of benches/peers/light.py and effects.py."""

import numpy as np

BARS = (0.05, 0.03, 0.02, 0.01)


def error(image, halves):
    """Returns the root mean square error beside a reference, divided by its mean. The noise of the reference is
    subtracted. It follows from the difference of its two halves."""
    a, b = halves
    whole = 0.5 * (a + b)
    square = ((image - whole) ** 2).mean() - 0.25 * ((a - b) ** 2).mean()
    return np.sqrt(max(square, 1e-10)) / whole.mean()


def at(curve, bar):
    """Returns the time in seconds at which a curve of (seconds, error) first falls to a limit, interpolated by powers
    between its points. Returns None when the curve stays above the limit."""
    best = []
    for seconds, e in sorted(curve):
        if not best or e < best[-1][1]:
            best.append((seconds, e))
    for (t0, e0), (t1, e1) in zip(best, best[1:]):
        if e0 > bar >= e1:
            return t0 * (t1 / t0) ** (np.log(e0 / bar) / np.log(e0 / e1))
    return min((t for t, e in best if e <= bar), default=None)


def beyond(curve, bar):
    """Returns the extrapolated time in seconds at which a curve that ends above a limit would reach it. The error is
    taken as noise, which falls with the square root of the time."""
    seconds, e = sorted(curve)[-1]
    return seconds * (e / bar) ** 2


def show(what, tables):
    """Prints the curves of programs, each a list of (setting, seconds, error), and the times at which they reach the
    errors of the bars. Names of our curves begin with "gelato"."""
    print(f"\n{what}\n\n| program | setting | seconds | error, % |\n|---|---|---|---|")
    for name, rows in tables:
        for setting, seconds, e in rows:
            print(f"| {name} | {setting} | {seconds:.2f} | {100 * e:.2f} |")
    ours = [name for name, _ in tables if name.startswith("gelato")]
    print("\n| error | " + " | ".join([name for name, _ in tables] + [f"{name} to the fastest of the others" for name in ours]) + " |")
    print("|---" * (1 + len(tables) + len(ours)) + "|")
    for bar in BARS:
        cells, times = [], []
        for name, rows in tables:
            curve = [r[1:] for r in rows]
            seconds = at(curve, bar)
            cells.append(f"{seconds:.2f} s" if seconds else "not reached")
            # What a denoiser does not remove does not fall with the number of samples.
            if not seconds and not name.startswith("gelato") and not name.endswith("denoised"):
                seconds = beyond(curve, bar)
                cells[-1] = f"{seconds:.1f} s, extrapolated"
            times.append(seconds)
        ours = [t for (name, _), t in zip(tables, times) if name.startswith("gelato")]
        others = [t for (name, _), t in zip(tables, times) if t and not name.startswith("gelato")]
        ratios = [f"{t / min(others):.2f}" if t and others else "" for t in ours]
        print(f"| {100 * bar:.0f} % | " + " | ".join(cells + ratios) + " |", flush=True)
