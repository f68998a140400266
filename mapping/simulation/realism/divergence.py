"""How far apart two collections of scans are, feature by feature.

The Jensen-Shannon divergence to base 2 is 0 for equal and 1 for disjoint histograms. A finite
sample inflates it: two draws from one distribution do not give 0. So like is compared with like.

- Most real streets here are one scan, so every comparison is one scan against one scan: of a longer
  drive, scans are drawn, several times, and the mean is taken.
- Both histograms are thinned to the same number of samples, and that number is the same for all
  pairs of a feature (the smallest median of any street that has at least `floor` samples), so the
  inflation is the same for simulated against real and for real against real.
- A street with fewer than `floor` samples in a group of a feature says nothing there; it is left
  out of that group and listed under `left_out`.
- A feature of few samples per scan (cars) pools the scans of a street first.
"""

import itertools

import numpy as np

# Beyond this many samples the inflation is far below any difference of interest, and thinning slow.
SAMPLE_CAP = 20000


def jensen_shannon(a, b):
    """Divergence in bits of two histograms of counts; NaN if one of them is empty."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    if a.sum() <= 0 or b.sum() <= 0:
        return float("nan")
    p, q = a / a.sum(), b / b.sum()
    m = (p + q) / 2

    def relative_entropy(x):
        on = x > 0
        return float((x[on] * np.log2(x[on] / m[on])).sum())

    return max(0.0, (relative_entropy(p) + relative_entropy(q)) / 2)


def thinned(counts, n, rng):
    """`n` of the samples of a histogram, drawn without putting back."""
    counts = np.asarray(counts, np.int64)
    return counts if counts.sum() <= n else rng.multivariate_hypergeometric(counts, n)


def sample_sizes(feature, scans_by_street):
    """Samples per group that every pair is thinned to, and who is left out: [(street, group)]."""
    sizes, left_out = [], []
    for g, group in enumerate(feature.groups):
        medians = {name: np.median([scan[g].sum() for scan in scans])
                   for name, scans in scans_by_street.items()}
        enough = [m for m in medians.values() if m >= feature.floor]
        left_out += [(name, group) for name, m in medians.items() if m < feature.floor]
        sizes.append(int(min(min(enough), SAMPLE_CAP)) if len(enough) > 1 else 0)
    return sizes, left_out


def scan_distance(a, b, feature, sizes, rng):
    """Mean divergence over the groups in which both scans have enough samples; NaN if in none."""
    parts = []
    for g, size in enumerate(sizes):
        n = min(size, int(a[g].sum()), int(b[g].sum()))
        if size and n >= feature.floor:
            parts.append(jensen_shannon(thinned(a[g], n, rng), thinned(b[g], n, rng)))
    return float(np.mean(parts)) if parts else float("nan")


def street_distances(feature, scans_by_street, draws, seed):
    """{(street, street): array of `draws` distances}; a street with itself where it has scans."""
    if feature.pooled:
        scans_by_street = {k: [np.sum(v, axis=0)] for k, v in scans_by_street.items()}
    sizes, left_out = sample_sizes(feature, scans_by_street)
    rng = np.random.default_rng(seed)
    distances = {}
    for a, b in itertools.combinations_with_replacement(scans_by_street, 2):
        one, other = scans_by_street[a], scans_by_street[b]
        if a == b and len(one) < 2:
            continue
        values = []
        for _ in range(draws):
            i = rng.integers(len(one))
            # Another scan of the same street, never the scan itself.
            j = (i + rng.integers(1, len(one))) % len(one) if a == b else rng.integers(len(other))
            values.append(scan_distance(one[i], other[j], feature, sizes, rng))
        distances[a, b] = distances[b, a] = np.array(values)
    return distances, sizes, left_out


def _mean(values):
    values = [v for v in values if np.isfinite(v)]
    return float(np.mean(values)) if values else float("nan")


def ratio_of(pair_means, simulated, real):
    """(simulated-real, real-real) means over streets; pairs of one street with itself left out."""
    across = _mean(pair_means[s, r] for s in simulated for r in real)
    among = _mean(pair_means[a, b] for a, b in itertools.combinations(real, 2) if a != b)
    return across, among


def compare(feature, counts, simulated, real, draws=12, seed=1, resamples=400):
    """Divergence of the simulated streets from the real ones, beside that among the real ones.

    @param counts  {street: [array groups x bins per scan]}, all simulated and real streets.
    @return a dictionary: sim_real, real_real, ratio, the 5 % and 95 % of the ratio when streets and
            draws are drawn anew (`range`), same_street (scans of one real street), per real street.
    """
    distances, sizes, left_out = street_distances(feature, counts, draws, seed)
    means = {pair: _mean(values) for pair, values in distances.items()}
    across, among = ratio_of(means, simulated, real)
    rng = np.random.default_rng(seed)
    ratios = []
    for _ in range(resamples):
        again = {p: _mean(rng.choice(v, len(v))) for p, v in distances.items() if p[0] <= p[1]}
        again |= {(b, a): v for (a, b), v in again.items()}
        x, y = ratio_of(again, rng.choice(simulated, len(simulated)), rng.choice(real, len(real)))
        if y > 0:
            ratios.append(x / y)
    spread = np.percentile(ratios, [5, 95]).tolist() if ratios else None
    return {
        "sim_real": across, "real_real": among,
        "ratio": across / among if among > 0 else float("nan"), "range": spread,
        "same_street": _mean(means.get((r, r), float("nan")) for r in real),
        "by_real": {r: _mean(means[s, r] for s in simulated) for r in real},
        "real_by_real": {r: _mean(means[r, o] for o in real if o != r) for r in real},
        "samples": dict(zip(feature.groups, sizes)),
        "left_out": [f"{street} in {group}" for street, group in left_out],
    }
