"""Runs a set and says what came out: a table, JSON and a diagram."""

import answers
import batches
import diagram
import figures
import hard
import nominal
import unsolvable

MODULES = {"unsolvable": unsolvable, "hard": hard, "nominal": nominal}
# Answers that must not be, each of which is listed.
LISTED = {"unsolvable": figures.is_ok, "hard": figures.false_ok, "nominal": figures.false_ok}


def run_set(name, program, options):
    module = MODULES[name]
    tables = batches.run_all(name, module.batches(program, options), options.folder / name, program.digest(),
                             options.jobs)
    values, limits = getattr(figures, name)(list(tables.values()))
    everything = answers.joined(list(tables.values()))
    listed = figures.listed(tables, LISTED[name])
    text = "\n".join([*heading(name, tables, everything), *lines_of(values), *limit_lines(limits),
                      *listed_lines(listed)])
    print(text, flush=True)
    (options.folder / f"{name}.txt").write_text(text + "\n")
    draw(name, everything, options.folder / f"{name}.png",
         f"{name}: {len(everything['status'])} queries, {len(tables)} drives")
    return {"figures": values, "limits": limits, "listed": listed, "drives": figures.by_drive(tables)}


def draw(name, everything, file, title):
    if name != "unsolvable":
        diagram.stanford(everything, file, title)
        return
    kinds = sorted(set(everything["kind"]))
    diagram.statuses({str(kind): figures.statuses([answers.where(everything, everything["kind"] == kind)])
                      for kind in kinds}, file, title)


def heading(name, tables, everything):
    return [f"== {name}: {len(everything['status'])} queries on {len(tables)} drives"]


def lines_of(values, indent="  "):
    """A dict of figures as lines, rates with their counts and bounds."""
    lines = []
    for key, value in values.items():
        if isinstance(value, dict) and "upper_95" in value:
            lines.append(f"{indent}{key:24} {shown_rate(value)}")
        elif isinstance(value, dict):
            inner = lines_of(value, indent + "  ")
            simple = all(not isinstance(v, dict) for v in value.values())
            lines += [f"{indent}{key:24} " + ", ".join(f"{k} {shown(v)}" for k, v in value.items())] if simple \
                else [f"{indent}{key}", *inner]
        else:
            lines.append(f"{indent}{key:24} {shown(value)}")
    return lines


def shown(value):
    if isinstance(value, list):
        return " to ".join(shown(v) for v in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def shown_rate(value):
    if value["of"] == 0:
        return "none asked"
    return (f"{value['count']} of {value['of']} = {100.0 * value['rate']:.3f} %, "
            f"at most {100.0 * value['upper_95']:.3f} % (95 %, by drive)")


def limit_lines(limits):
    lines = []
    for limit in limits:
        bounds = [f"{word} {shown(limit[key])}" for word, key in (("at least", "at_least"), ("at most", "at_most"))
                  if limit[key] is not None]
        lines.append(f"  {'holds ' if limit['holds'] else 'BROKEN'} {limit['what']}: {shown(limit['value'])}, "
                     f"{' and '.join(bounds)}")
    return lines


def listed_lines(listed):
    return [f"  {line['drive']} {line['kind']} scan {line['scan']} trial {line['trial']}: off by "
            f"{line['error_m']:.2f} m {line['error_deg']:.2f} deg, inliers {line['inlier_ratio']:.2f}"
            for line in listed]


# A rate of 1 in 1,000 shows twice in a quick run's 100 queries in one of 200 runs.
QUICK_LISTED = 1
QUICK_ALLOWANCE = 0.1


def broken(result, quick):
    """What must not be. Few queries say little about rates, so a quick run allows more."""
    lines = []
    for name, part in result["sets"].items():
        if not quick:
            lines += [f"{name}: {line['what']}" for line in part["limits"] if not line["holds"]]
            continue
        if len(part["listed"]) > QUICK_LISTED:
            lines.append(f"{name}: {len(part['listed'])} answers that must not be")
        lines += [f"{name}: {line['what']}" for line in part["limits"]
                  if line["what"].endswith("share of queries") and line["at_least"] is not None
                  and not line["value"] >= line["at_least"] - QUICK_ALLOWANCE]
    return lines
