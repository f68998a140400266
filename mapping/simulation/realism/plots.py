"""One figure per feature, and an overview: simulated against each real street."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from features import FEATURES
from report import BAR, sorted_rows

# Okabe and Ito's colours, told apart by the colour-blind too; simulated streets share the first.
_SIMULATED = "#D55E00"
_REAL = ("#0072B2", "#56B4E9", "#009E73", "#CC79A7", "#000000", "#999999")
_MAX_PANELS = 8


def _pooled(scans, key):
    return np.sum([c[key] for c in scans], axis=0)


def _styles(simulated, real):
    """(street, drawing options): the real ones as thin lines, the simulated ones thick on top."""
    rows = [(name, {"color": _REAL[i % len(_REAL)], "lw": 1.3, "label": f"real: {name[-22:]}"})
            for i, name in enumerate(real)]
    dashes = ("-", "--", ":", "-.")
    return rows + [(name, {"color": _SIMULATED, "lw": 2.0, "ls": dashes[i % 4],
                           "label": f"simulated: {name[-17:]}"})
                   for i, name in enumerate(simulated)]


def _profile_panel(axes, feature, counts, styles):
    middle = np.array([float(g.split()[0]) + 0.5 for g in feature.groups])
    for name, style in styles:
        back, lost = _pooled(counts[name], feature.key).T
        total = back + lost
        seen = total > 0
        axes.plot(middle[seen], 100.0 * lost[seen] / total[seen], **style)
    axes.set_xlabel(feature.unit)
    axes.set_ylabel("shots that did not come back [%]")
    axes.set_ylim(bottom=0)


def _histogram_panel(axes, feature, g, counts, styles):
    """Shares per bin as steps; the bins are drawn equally wide where their widths differ much."""
    edges = np.array(feature.edges)
    uneven = np.ptp(np.diff(edges)) > 1e-6
    x = np.arange(len(edges)) if uneven else edges
    for name, style in styles:
        h = _pooled(counts[name], feature.key)[g]
        if h.sum():
            axes.stairs(100.0 * h / h.sum(), x, **style)
    if uneven:
        every = max(1, len(edges) // 8)
        axes.set_xticks(x[::every], [f"{e:.3g}" for e in edges[::every]])
    axes.set_xlim(x[0], x[-1])
    axes.set_xlabel(feature.unit)
    axes.set_ylabel("share [%]")
    if len(feature.groups) > 1:
        axes.set_title(feature.groups[g], fontsize=10)


def _draw_feature(folder, feature, result, counts, styles):
    panels = 1 if feature.profile else min(len(feature.groups), _MAX_PANELS)
    columns = min(panels, 4)
    rows = -(-panels // columns)
    figure, grid = plt.subplots(rows, columns, squeeze=False, layout="constrained",
                                figsize=(max(7.5, 4.2 * columns), 3.6 * rows + 0.9))
    for g, axes in enumerate(grid.ravel()):
        if g >= panels:
            axes.axis("off")
        elif feature.profile:
            _profile_panel(axes, feature, counts, styles)
        else:
            _histogram_panel(axes, feature, g, counts, styles)
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
    ratio = f", ratio {result['ratio']:.2f}" if np.isfinite(result["ratio"]) else ""
    figure.suptitle(f"{feature.title} (divergence {result['sim_real']:.3f}{ratio})")
    handles = {}
    for axes in grid.ravel():
        for handle, label in zip(*axes.get_legend_handles_labels()):
            handles.setdefault(label, handle)
    figure.get_layout_engine().set(rect=(0.0, 0.12, 1.0, 0.88))
    figure.legend(handles.values(), handles.keys(), loc="lower center",
                  ncols=min(4, len(handles)), fontsize=8, frameon=False)
    figure.savefig(folder / f"{feature.key}.png", dpi=110)
    plt.close(figure)


def _draw_overview(folder, results):
    rows = [(k, r) for k, r in sorted_rows(results) if np.isfinite(r["ratio"])][::-1]
    figure, axes = plt.subplots(figsize=(8, 0.33 * len(rows) + 1.4), layout="constrained")
    for y, (_, r) in enumerate(rows):
        low, high = r["range"] or (r["ratio"], r["ratio"])
        color = "#009E73" if r["ratio"] <= BAR else _SIMULATED
        axes.plot([low, high], [y, y], color=color, lw=4, alpha=0.35, solid_capstyle="butt")
        axes.plot(r["ratio"], y, "o", color=color)
    axes.axvline(1.0, color="black", lw=0.8)
    axes.axvline(BAR, color="black", lw=0.8, ls="--")
    axes.text(BAR, len(rows) - 0.4, f" bar {BAR}", fontsize=8)
    axes.set_xscale("log")
    ticks = (0.5, 1, 2, 5, 10, 20, 50, 100)
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.minorticks_off()
    axes.set_yticks(range(len(rows)), [k.replace("_", " ") for k, _ in rows])
    axes.set_xlabel("divergence simulated-real / real-real (line: 5 to 95 %)")
    axes.grid(axis="x", alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(folder / "overview.png", dpi=110)
    plt.close(figure)


def draw_all(folder, results, counts, simulated, real):
    """Writes `<feature>.png` for every feature and `overview.png` into the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    styles = _styles(simulated, real)
    for feature in FEATURES:
        _draw_feature(folder, feature, results[feature.key], counts, styles)
    _draw_overview(folder, results)
