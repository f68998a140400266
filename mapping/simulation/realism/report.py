"""The table of divergences, and the facts beside it, as text."""

import numpy as np

# The bar: simulated streets may differ from real ones half as much again as real ones do.
BAR = 1.5


def _number(value, form="{:.3f}"):
    return form.format(value) if value is not None and np.isfinite(value) else "-"


def sorted_rows(results):
    """(key, result), the worst ratio first, those without a ratio last."""
    return sorted(results.items(),
                  key=lambda kv: -kv[1]["ratio"] if np.isfinite(kv[1]["ratio"]) else np.inf)


def divergence_table(results):
    lines = [f"{'feature':<19}{'sim-real':>9}{'real-real':>10}{'ratio':>7}  {'5..95 %':<13}"
             f"{'same street':>11}  bar {BAR}"]
    for key, r in sorted_rows(results):
        spread = "..".join(_number(v, "{:.2f}") for v in r["range"]) if r["range"] else "-"
        verdict = "-" if not np.isfinite(r["ratio"]) else ("ok" if r["ratio"] <= BAR else "ABOVE")
        lines.append(f"{key:<19}{_number(r['sim_real']):>9}{_number(r['real_real']):>10}"
                     f"{_number(r['ratio'], '{:.2f}'):>7}  {spread:<13}"
                     f"{_number(r['same_street']):>11}  {verdict}")
    return "\n".join(lines)


def real_table(results, real):
    """Per real street: mean divergence of the simulated ones / of the other real ones."""
    lines = [f"{'feature':<19}" + "".join(f"{name[-18:]:>20}" for name in real)]
    for key, r in sorted_rows(results):
        lines.append(f"{key:<19}" + "".join(
            f"{_number(r['by_real'][n]) + ' / ' + _number(r['real_by_real'][n]):>20}"
            for n in real))
    return "\n".join(lines)


def left_out_lines(results):
    lines = []
    for key, r in results.items():
        by_street = {}
        for entry in r["left_out"]:
            street, _, group = entry.partition(" in ")
            by_street.setdefault(street, []).append(group)
        lines += [f"  {key}: {street} in {len(groups)} group(s): {', '.join(groups[:4])}"
                  + (", ..." if len(groups) > 4 else "") for street, groups in by_street.items()]
    return "\n".join(lines) or "  nothing"


def facts_table(facts):
    """Means over the scans of every street."""
    lines = [f"{'street':<30}{'scans':>6}{'points':>9}{'shots':>7}{'back':>7}{'nearest':>9}"
             f"{'farthest':>9}{'ground':>8}  rings"]
    for name, scans in facts.items():
        def mean(key):
            return np.mean([f[key] for f in scans])
        notes = sorted({n for f in scans for n in f["notes"]})
        lines.append(f"{name[:29]:<30}{len(scans):>6}{mean('points'):>9.0f}{mean('shots'):>7.0f}"
                     f"{mean('points') / mean('shots') / 64:>7.3f}{mean('nearest_m'):>8.2f}m"
                     f"{mean('farthest_m'):>8.1f}m{mean('ground_share'):>8.2f}  "
                     f"{'; '.join(notes) or 'ok'}")
    return "\n".join(lines)


def class_table(shares):
    names = list(shares)
    if not names:
        return "  no labelled street"
    lines = [f"{'class':<15}" + "".join(f"{n[-14:]:>16}" for n in names)]
    for c in shares[names[0]]:
        lines.append(f"{c:<15}" + "".join(f"{100 * shares[n][c]:>14.2f} %" for n in names))
    return "\n".join(lines)
