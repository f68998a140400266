"""Stanford diagrams: level against true error, as in satellite navigation."""

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402
from matplotlib.colors import LogNorm  # noqa: E402
import numpy as np  # noqa: E402

import figures  # noqa: E402

STATUS_COLOURS = {"ok": "#c0392b", "degraded": "#e0a030", "lost": "#7f8c8d"}


def _panel(axes, error, level, limit, name, unit):
    known = np.isfinite(error) & np.isfinite(level)
    error, level = error[known], level[known]
    low = limit * 1e-4
    high = max(limit * 10.0, 1.5 * np.max(error, initial=0.0), 1.5 * np.max(level, initial=0.0))
    edges = np.geomspace(low, high, 90)
    counts, _, _ = np.histogram2d(error.clip(low * 1.001, None), level.clip(low * 1.001, None), bins=[edges, edges])
    drawn = axes.pcolormesh(edges, edges, np.ma.masked_equal(counts.T, 0), norm=LogNorm(1, max(counts.max(), 2)),
                            cmap="viridis")
    corner = [low, high]
    axes.plot(corner, corner, "k", lw=1)
    axes.fill_between(corner, corner, [low, low], color="#e0a030", alpha=0.18, lw=0)
    axes.fill_between([limit, high], [limit, limit], [low, low], color="#c0392b", alpha=0.3, lw=0)
    axes.fill_between(corner, [limit, limit], [high, high], color="#7f8c8d", alpha=0.18, lw=0)
    axes.plot([limit, limit], [low, limit], "k--", lw=0.8)
    axes.plot([low, high], [limit, limit], "k--", lw=0.8)
    bad = error > level
    axes.plot(error[bad], level[bad], "rx", ms=5, label=f"{np.count_nonzero(bad)} beyond their level")
    axes.set(xscale="log", yscale="log", xlim=corner, ylim=corner, xlabel=f"true error of the {name} [{unit}]",
             ylabel=f"protection level [{unit}]", title=f"{name}: {len(error)} ok, {np.count_nonzero(bad)} misleading")
    place = {"transform": axes.transAxes, "fontsize": 8}
    axes.text(0.03, 0.96, "not available", va="top", **place)
    axes.text(0.97, 0.03, "hazardous", ha="right", **place)
    axes.text(0.55, 0.3, "misleading", **place)
    return drawn


def stanford(table, file, title):
    """Level against error of every `ok` on four axes; the darker zones are the worse ones."""
    table = {name: column[figures.is_ok(table)] for name, column in table.items()}
    figure, panels = pyplot.subplots(2, 2, figsize=(12, 11), layout="constrained")
    degrees = 180.0 / np.pi
    for axes, (name, error, level, limit, scale, unit) in zip(panels.flat, [
            ("longitudinal position", "error_x_m", "level_longitudinal_m", figures.ALERT_M, 1.0, "m"),
            ("lateral position", "error_y_m", "level_lateral_m", figures.ALERT_M, 1.0, "m"),
            ("height", "error_z_m", "level_vertical_m", figures.ALERT_M, 1.0, "m"),
            ("yaw", "error_yaw_rad", "level_yaw_rad", figures.ALERT_DEG, degrees, "deg")]):
        drawn = _panel(axes, np.abs(table[error]) * scale, table[level] * scale, limit, name, unit)
        figure.colorbar(drawn, ax=axes, label="answers")
    figure.suptitle(title)
    figure.savefig(file, dpi=90)
    pyplot.close(figure)


def statuses(by_kind, file, title):
    """Shares of ok, degraded and lost of each kind (name -> counts), where no error is defined."""
    figure, axes = pyplot.subplots(figsize=(10, 0.45 * len(by_kind) + 1.8), layout="constrained")
    names = list(by_kind)[::-1]
    left = np.zeros(len(names))
    for status, colour in STATUS_COLOURS.items():
        shares = np.array([by_kind[name][status] / max(1, sum(by_kind[name].values())) for name in names])
        axes.barh(names, shares, left=left, color=colour, label=status)
        left += shares
    for row, name in enumerate(names):
        axes.text(1.01, row, f"{by_kind[name]['ok']} ok of {sum(by_kind[name].values())}", va="center", fontsize=8)
    axes.set(xlim=(0, 1), xlabel="share of queries", title=title)
    axes.legend(loc="lower left")
    figure.savefig(file, dpi=90)
    pyplot.close(figure)
