"""Rates and how large they may really be. Queries of one drive share its street, so drives are what is resampled."""

import math

import numpy as np

RESAMPLINGS = 4000
LEVEL = 0.95


def binomial_upper(count, whole):
    """Largest rate at which `count` or fewer of `whole` are seen with probability 5 % (Clopper and Pearson)."""
    if whole == 0 or count >= whole:
        return 1.0
    k = np.arange(count + 1)
    log_choose = np.array([math.lgamma(whole + 1) - math.lgamma(i + 1) - math.lgamma(whole - i + 1) for i in k])
    low, high = count / whole, 1.0
    for _ in range(60):
        p = (low + high) / 2.0
        below = np.exp(log_choose + k * math.log(p) + (whole - k) * math.log1p(-p)).sum() if p < 1.0 else 0.0
        low, high = (p, high) if below > 1.0 - LEVEL else (low, p)
    return high


def resampled_upper(counts, wholes, seed=1):
    """95 % point of the rate when whole drives are drawn with replacement."""
    counts, wholes = np.asarray(counts, float), np.asarray(wholes, float)
    drawn = np.random.default_rng(seed).integers(0, len(counts), (RESAMPLINGS, len(counts)))
    sums = wholes[drawn].sum(axis=1)
    rates = np.divide(counts[drawn].sum(axis=1), sums, out=np.zeros(RESAMPLINGS), where=sums > 0.0)
    return float(np.quantile(rates, LEVEL))


def rate(counts, wholes):
    """{count, of, rate, upper_95} from counts by drive.

    Resampling sees nothing of what never happened and little of what happened on one drive, so the bound is the
    larger one of that and Clopper's and Pearson's (without a count: some 3 / n).
    """
    count, whole = int(np.sum(counts)), int(np.sum(wholes))
    if whole == 0:
        return {"count": 0, "of": 0, "rate": None, "upper_95": None}
    upper = max(resampled_upper(counts, wholes), binomial_upper(count, whole))
    return {"count": count, "of": whole, "rate": count / whole, "upper_95": upper}


def rate_of(events, of):
    """The same from a mask of events and one of what they are counted among, by drive (lists of arrays)."""
    return rate([np.count_nonzero(e & o) for e, o in zip(events, of)], [np.count_nonzero(o) for o in of])


def resampled_interval(tables, figure, seed=1, resamplings=1000):
    """5 % and 95 % points of `figure(list of tables)` when whole drives are drawn with replacement."""
    random = np.random.default_rng(seed)
    values = [figure([tables[i] for i in random.integers(0, len(tables), len(tables))]) for _ in range(resamplings)]
    return [float(v) for v in np.nanquantile(values, [0.05, 0.95])]
