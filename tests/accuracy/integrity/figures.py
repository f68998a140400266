"""What the answers of each set say, against the limits."""

import numpy as np

import answers
import rates

# Alert limits of street driving: horizontal position, and yaw.
ALERT_M = 0.29
ALERT_DEG = 0.5
# Beyond these an answer that was `ok` is false.
FALSE_M = 0.5
FALSE_DEG = 2.0
# Within these a pose is as good as one can ask for.
CLOSE_M = 0.2
CLOSE_DEG = 1.0
# 95 % point of chi-squared with 6 degrees of freedom.
CHI_SQUARED_95 = 12.592
AXES = ["longitudinal", "lateral", "vertical", "yaw"]
ALERTS = {"longitudinal": ALERT_M, "lateral": ALERT_M, "yaw": np.radians(ALERT_DEG)}


class Limits:
    """Collects what was held against what."""

    def __init__(self):
        self.lines = []

    def __call__(self, what, value, low=None, high=None):
        holds = value is not None and np.isfinite(value) and (low is None or value >= low) \
            and (high is None or value <= high)
        self.lines.append({"what": what, "value": value, "at_least": low, "at_most": high, "holds": bool(holds)})


def is_ok(table):
    return table["status"] == "ok"


def has_pose(table):
    return table["status"] != "lost"


def right(table, metres, degrees):
    m, deg = answers.errors_of(table)
    return has_pose(table) & (m <= metres) & (deg <= degrees)


def false_ok(table):
    return is_ok(table) & ~right(table, FALSE_M, FALSE_DEG)


def beyond_level(table):
    """By axis: `ok`, and the error is beyond its level."""
    return {axis: is_ok(table) & (np.abs(table[error]) > table[level])
            for axis, error, level in zip(AXES, answers.BOUNDED, answers.LEVELS)}


def hazards(table):
    """By axis with an alert limit: `ok`, the error is beyond the limit and the level is not."""
    columns = dict(zip(AXES, zip(answers.BOUNDED, answers.LEVELS)))
    return {axis: is_ok(table) & (np.abs(table[columns[axis][0]]) > limit) & (table[columns[axis][1]] <= limit)
            for axis, limit in ALERTS.items()}


def available(table):
    """`ok` with every level inside its alert limit."""
    columns = dict(zip(AXES, answers.LEVELS))
    return is_ok(table) & np.all([table[columns[axis]] <= limit for axis, limit in ALERTS.items()], axis=0)


def any_of(masks):
    return np.any(list(masks.values()), axis=0)


def horizontal(table):
    """Level and error of the horizontal position [m]."""
    return (np.hypot(table["level_longitudinal_m"], table["level_lateral_m"]),
            np.hypot(table["error_x_m"], table["error_y_m"]))


def median_level_over_error(tables):
    ratios = []
    for table in tables:
        level, error = horizontal(table)
        asked = is_ok(table) & np.isfinite(level)
        ratios.append(level[asked] / np.maximum(error[asked], 1e-6))
    ratios = np.concatenate(ratios)
    return float(np.median(ratios)) if len(ratios) else np.nan


def nees_of(tables):
    values = np.concatenate([table["nees"][is_ok(table)] for table in tables])
    return values[np.isfinite(values)]


def mean(values):
    return float(np.mean(values)) if len(values) else np.nan


def statuses(tables):
    status = np.concatenate([table["status"] for table in tables])
    return {name: int(np.count_nonzero(status == name)) for name in ("ok", "degraded", "lost")}


def percentiles(values):
    if not len(values):
        return {"median": None, "p95": None, "worst": None}
    return {"median": float(np.median(values)), "p95": float(np.quantile(values, 0.95)),
            "worst": float(np.max(values))}


def error_figures(tables):
    table = answers.where(joined := answers.joined(tables), has_pose(joined))
    m, deg = answers.errors_of(table)
    return {"translation_m": percentiles(m), "rotation_deg": percentiles(deg)}


def nominal(tables):
    """Figures and limits of the set `nominal`; `tables` by drive."""
    everything = [np.ones(len(t["status"]), bool) for t in tables]
    oks = [is_ok(t) for t in tables]
    nees = nees_of(tables)
    figures = {
        "drives": len(tables),
        "status": statuses(tables),
        **error_figures(tables),
        "lost_or_beyond_0.2m_1deg": rates.rate_of([~right(t, CLOSE_M, CLOSE_DEG) for t in tables], everything),
        "false_ok": rates.rate_of([false_ok(t) for t in tables], oks),
        "misleading": rates.rate_of([any_of(beyond_level(t)) for t in tables], oks),
        "misleading_by_axis": {axis: rates.rate_of([beyond_level(t)[axis] for t in tables], oks) for axis in AXES},
        "hazardous": rates.rate_of([any_of(hazards(t)) for t in tables], oks),
        "unavailable": rates.rate_of([~available(t) for t in tables], everything),
        "level_over_error": {"median": median_level_over_error(tables),
                             "interval_90": rates.resampled_interval(tables, median_level_over_error)},
        "nees": {"mean": mean(nees), "below_95_point": mean(nees < CHI_SQUARED_95),
                 "mean_interval_90": rates.resampled_interval(tables, lambda some: mean(nees_of(some)))},
    }
    limits = Limits()
    limits("misleading, share of ok", figures["misleading"]["rate"], high=1e-3)
    limits("hazardous, count", figures["hazardous"]["count"], high=0)
    limits("available, share of queries", 1.0 - figures["unavailable"]["rate"], low=0.95)
    limits("level over error, median", figures["level_over_error"]["median"], high=8.0)
    limits("squared error over covariance, mean", figures["nees"]["mean"], low=4.0, high=9.0)
    limits("... below 12.59, share", figures["nees"]["below_95_point"], low=0.90, high=0.99)
    return figures, limits.lines


def by_kind(tables, event, among=None):
    """Rates of each kind; drives without it do not count."""
    rate = {}
    for kind in sorted(set(np.concatenate([t["kind"] for t in tables]))):
        some = [t for t in (answers.where(t, t["kind"] == kind) for t in tables) if len(t["status"])]
        rate[str(kind)] = rates.rate_of([event(t) for t in some],
                                        [among(t) if among else np.ones(len(t["status"]), bool) for t in some])
    return rate


def listed(batches, mask):
    """One line for each answer that `mask` (of a table) picks out, `batches` by name."""
    lines = []
    for name, table in batches.items():
        m, deg = answers.errors_of(table)
        for i in np.flatnonzero(mask(table)):
            lines.append({"drive": name, "kind": str(table["kind"][i]), "scan": int(table["scan"][i]),
                          "trial": int(table["trial"][i]), "error_m": float(m[i]), "error_deg": float(deg[i]),
                          "inlier_ratio": float(table["inlier_ratio"][i])})
    return lines


def unsolvable(tables):
    """Figures and limits of the set `unsolvable`."""
    everything = [np.ones(len(t["status"]), bool) for t in tables]
    figures = {"drives": len(tables), "status": statuses(tables),
               "ok": rates.rate_of([is_ok(t) for t in tables], everything),
               "ok_by_kind": by_kind(tables, is_ok),
               "not_lost": rates.rate_of([has_pose(t) for t in tables], everything)}
    limits = Limits()
    limits("ok, share of queries", figures["ok"]["rate"], high=1e-3)
    return figures, limits.lines


# One block off no localizer can find the street again without searching everywhere; it can say that it is not sure.
MAY_BE_UNSURE = ["parallel_street"]


def handled(table):
    """Right, or, where that is all that can be asked for, not sure."""
    return right(table, FALSE_M, FALSE_DEG) | (np.isin(table["kind"], MAY_BE_UNSURE) & ~is_ok(table))


def hard(tables):
    """Figures and limits of the set `hard`."""
    everything = [np.ones(len(t["status"]), bool) for t in tables]
    figures = {"drives": len(tables), "status": statuses(tables), **error_figures(tables),
               "wrong": rates.rate_of([~handled(t) for t in tables], everything),
               "wrong_by_kind": by_kind(tables, lambda t: ~handled(t)),
               "false_ok": rates.rate_of([false_ok(t) for t in tables], [has_pose(t) for t in tables]),
               "false_ok_by_kind": by_kind(tables, false_ok, has_pose),
               "not_ok_by_kind": by_kind(tables, lambda t: ~is_ok(t)),
               "misleading": rates.rate_of([any_of(beyond_level(t)) for t in tables], [is_ok(t) for t in tables])}
    limits = Limits()
    limits("right, share of queries", 1.0 - figures["wrong"]["rate"], low=0.9)
    limits("false ok, share of answers with a pose", figures["false_ok"]["rate"], high=1e-3)
    return figures, limits.lines


def by_drive(batches):
    """Per-drive lines for the report: where the misses are."""
    lines = {}
    for name, table in batches.items():
        lines[name] = {"queries": len(table["status"]), "status": statuses([table]),
                       "misleading": int(np.count_nonzero(any_of(beyond_level(table)))),
                       "false_ok": int(np.count_nonzero(false_ok(table))),
                       "unavailable": int(np.count_nonzero(~available(table))),
                       "nees_mean": mean(nees_of([table])),
                       "level_over_error": median_level_over_error([table])}
    return lines
