"""From pytest-benchmark's JSON to the tables and figures of the documentation.

`python -m tests.benchmarks.report RUN.json --out docs/benchmarks.md` replaces what stands between the page's two marks,
and writes the figures to `images` beside the page. Without `--out` the table is printed, which is enough for a run of a
few benchmarks.
"""

import argparse
import json
import math
from collections import defaultdict
from pathlib import Path

MARKS = "<!-- measured: begin -->", "<!-- measured: end -->"

AXES = {
    "points": ("points", "CPU seconds of a fit"),
    "components": ("components", "CPU seconds of an EM iteration, 20,000 points"),
    "restarts": ("restarts in one call", "seconds a restart"),
    "cores": ("cores", "wall seconds"),
    "steps": ("EM steps", "MB of a gradient, 20,000 points"),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="what --benchmark-json wrote")
    parser.add_argument("--out", type=Path, help="the page, with its two marks")
    arguments = parser.parse_args()
    run = json.loads(arguments.run.read_text())
    if arguments.out:
        write_report(run, arguments.out)
    else:
        print(conditions(run), table_of_targets(run), sep="\n\n")


def write_report(run: dict, page: Path) -> None:
    """Fills the page, and draws the figures beside it."""
    before, rest = page.read_text().split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    figures = draw_figures(run, page.parent / "images")
    images = [f"![{figure}](images/{path.name})" for figure, path in figures.items()]
    parts = [
        conditions(run),
        table_of_targets(run),
        *section("## What was found", answers(run)),
        "## Times",
        table_of_times(run),
        *section("## Scaling", images),
    ]
    page.write_text(before + "\n\n".join([MARKS[0], *parts, MARKS[1]]) + after)


def section(title: str, parts: list[str]) -> list[str]:
    """The title and what follows it; nothing where a run chose other benchmarks."""
    return [title, *parts] if parts else []


def conditions(run: dict) -> str:
    """Where and how it was measured."""
    machine, extra = run["machine_info"], run["benchmarks"][0]["extra_info"]
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
    loads = [load for benchmark in run["benchmarks"] for load in benchmark["extra_info"]["load"]]
    quick = " A trial with `--quick`: small sizes and two repeats, not what was asked for." if extra["quick"] else ""
    processor = machine["cpu"].get("brand_raw", "unknown processor")
    return (
        f"{run['datetime'][:10]}, {processor}, {extra['cores']} cores, JAX on {machine['device']}; "
        f"load {min(loads):.1f} to {max(loads):.1f}. Python {machine['python_version']}, {versions}.{quick}"
    )


def table_of_targets(run: dict) -> str:
    """What was asked, and what was measured."""
    lines = ["| what | asked | measured | reached | ours | peer | load |", "|---|---|---|---|---|---|---|"]
    for benchmark in run["benchmarks"]:
        extra = benchmark["extra_info"]
        for row in extra["rows"]:
            cells = [row["what"], *target(row), row["ours"], row["peer"], f"{max(extra['load']):.1f}"]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def target(row: dict) -> list[str]:
    """What was asked, what was measured, and whether it was reached."""
    measured = f"{number(row['measured'])} {row['unit']}".strip()
    if row["asked"] is None:
        return ["", measured, ""]
    reached = row["measured"] >= row["asked"] if row["least"] else row["measured"] <= row["asked"]
    sign = "≥" if row["least"] else "≤"
    return [f"{sign} {number(row['asked'])} {row['unit']}".strip(), measured, "yes" if reached else "**no**"]


def number(value: float) -> str:
    """Three digits."""
    if not math.isfinite(value):
        return "not finite"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def answers(run: dict) -> list[str]:
    """What the contenders found, one table for each benchmark that says so."""
    tables = []
    for benchmark in run["benchmarks"]:
        if found := benchmark["extra_info"].get("answers"):
            names = list(found)
            lines = [f"| {benchmark['name']} | " + " | ".join(name.replace("_", " ") for name in names) + " |"]
            lines.append("|---" * (len(names) + 1) + "|")
            contenders = dict.fromkeys(contender for by_contender in found.values() for contender in by_contender)
            for contender in contenders:
                values = [", ".join(f"{value:.10g}" for value in found[name][contender]) for name in names]
                lines.append(f"| {contender} | " + " | ".join(values) + " |")
            tables.append("\n".join(lines))
    return tables


def table_of_times(run: dict) -> str:
    """Medians of every contender."""
    lines = ["| benchmark | contender | CPU, s | wall, s | compilation, s |", "|---|---|---|---|---|"]
    for benchmark in run["benchmarks"]:
        for name, times in benchmark["extra_info"]["contenders"].items():
            values = [number(times[part]) for part in ("cpu_s", "wall_s", "compilation_s")]
            lines.append(f"| {benchmark['name']} | {name} | " + " | ".join(values) + " |")
    return "\n".join(lines)


def draw_figures(run: dict, folder: Path) -> dict[str, Path]:
    """One logarithmic plot for each figure; the same run gives the same files."""
    import matplotlib

    matplotlib.use("agg")
    matplotlib.rcParams["svg.hashsalt"] = "gmmjax"
    import matplotlib.pyplot as plt
    from matplotlib import ticker

    folder.mkdir(parents=True, exist_ok=True)
    drawn = {}
    for figure, lines in curves(run).items():
        x_label, y_label = AXES[figure]
        canvas, axes = plt.subplots(figsize=(6, 4), layout="constrained")
        for name, values in lines.items():
            axes.loglog(*zip(*sorted(values), strict=True), marker="o", label=name)
        measured = sorted({x for values in lines.values() for x, _ in values})
        axes.set_xticks(measured, [f"{x:,}" for x in measured])
        axes.yaxis.set_major_locator(ticker.LogLocator(subs=(1, 1.5, 2, 3, 5, 7) if len(lines) < 3 else (1, 3)))
        axes.yaxis.set_major_formatter(ticker.FuncFormatter(lambda y, _: f"{y:g}"))
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_minor_locator(ticker.NullLocator())
        axes.set(xlabel=x_label, ylabel=y_label)
        axes.grid(alpha=0.3)
        axes.legend()
        path = folder / f"benchmarks-{figure}.svg"
        canvas.savefig(path, metadata={"Date": None})
        plt.close(canvas)
        drawn[f"Scaling in {figure}"] = path
    return drawn


def curves(run: dict) -> dict[str, dict[str, list[tuple[float, float]]]]:
    """By figure and line the points (x, y); a line may come from several benchmarks."""
    gathered: dict[str, dict[str, list]] = defaultdict(lambda: defaultdict(list))
    for benchmark in run["benchmarks"]:
        for curve in benchmark["extra_info"]["curves"]:
            gathered[curve["figure"]][curve["line"]] += zip(curve["x"], curve["y"], strict=True)
    return gathered


if __name__ == "__main__":
    main()
