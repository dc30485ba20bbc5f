"""Charts of a report, made with Vega-Altair as Vega-Lite specifications; the page gives them colours and width."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

from graspbox._common.extras import imported
from graspbox.reports.runs import ReportRun

__all__ = ["bundle", "comparison_chart", "curve_charts", "failure_chart", "rate_chart", "reliability_chart"]

#: Height of a row of bars or intervals, pixels, and of other charts.
_STEP, _HEIGHT = 13, 240


def _altair() -> Any:
    return imported("altair", "a report needs altair, from the extra 'report'", "report")


@cache
def bundle() -> str:
    """Return the program that draws the charts: vega, vega-lite and vega-embed in one, without network.

    Raises
    ------
    MissingExtraError
        Without vl-convert-python (extra ``report``).
    """
    vl_convert = imported("vl_convert", "a report needs vl-convert-python, from the extra 'report'", "report")
    bundled: Callable[..., str] = vl_convert.javascript_bundle
    return bundled(vl_version=".".join(_altair().SCHEMA_VERSION.lstrip("v").split(".")[:2]))


def _spec(chart: Any, rows: int | None = None) -> dict[str, Any]:
    """Give a chart its size and the rules that all share."""
    sized = chart.properties(width="container", height=_HEIGHT if rows is None else max(rows, 2) * _STEP + 20)
    made: dict[str, Any] = sized.to_dict()
    # The page has the colours of both themes.
    made.pop("config", None)
    made["autosize"] = {"type": "fit-x", "contains": "padding"}
    return made


def _colour(alt: Any, names: Sequence[str], shown: Sequence[str] | None = None) -> Any:
    """Give each of the names its colour, the same in all charts; the legend lists those that are shown."""
    if len(names) < 2:
        return alt.Undefined
    values = list(names if shown is None else shown)
    legend = alt.Legend(
        orient="bottom", direction="vertical", title=None, labelLimit=330, symbolLimit=40, values=values
    )
    return alt.Color("run:N", sort=None, scale=alt.Scale(domain=list(names)), legend=legend)


def rate_chart(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, Any]:
    """Plot success rates with their intervals: a line for each name, a point for each run.

    Parameters
    ----------
    rows : sequence of mapping
        Rows of `graspbox.reports.tables.summary_rows`, in the order of the lines.
    names : sequence of str
        Names of the runs.
    """
    alt = _altair()
    values = [
        {
            "name": row["name"],
            "run": names[row["run"]],
            "rate": row["success"][0],
            "low": row["success"][1],
            "high": row["success"][2],
            "trials": row["trials"],
        }
        for row in rows
    ]
    order = list(dict.fromkeys(value["name"] for value in values))
    runs = list(dict.fromkeys(value["run"] for value in values))
    across = alt.X("rate:Q", title="success rate", scale=alt.Scale(domain=[0, 1]), axis=alt.Axis(format=".0%"))
    offset = alt.YOffset("run:N", sort=runs) if len(runs) > 1 else alt.Undefined
    tips = [alt.Tooltip("name:N"), alt.Tooltip("run:N"), alt.Tooltip("trials:Q")]
    tips += [alt.Tooltip(f"{name}:Q", format=".1%") for name in ("rate", "low", "high")]
    base = alt.Chart(alt.Data(values=values)).encode(
        alt.Y("name:N", sort=order, title=None), color=_colour(alt, names, runs), yOffset=offset, tooltip=tips
    )
    points = base.mark_point(filled=True, size=45, opacity=1).encode(across)
    lines = base.mark_rule(strokeWidth=1.5).encode(alt.X("low:Q", title="success rate"), alt.X2("high:Q"))
    return _spec(alt.layer(lines, points), max(len(values), 2 * len(order)))


def failure_chart(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, Any] | None:
    """Plot the share of the trials of each run that failed, by kind; None without failures by kind."""
    alt = _altair()
    values = [
        {"kind": kind, "run": names[row["run"]], "share": count / row["trials"], "count": count}
        for row in rows
        for kind, count in row["failures"].items()
    ]
    if not values:
        return None
    runs = [names[row["run"]] for row in rows]
    offset = alt.YOffset("run:N", sort=runs) if len(runs) > 1 else alt.Undefined
    chart = (
        alt.Chart(alt.Data(values=values))
        .mark_bar()
        .encode(
            alt.X("share:Q", title="share of trials", axis=alt.Axis(format=".0%")),
            alt.Y("kind:N", title=None),
            yOffset=offset,
            color=_colour(alt, names, runs),
            tooltip=["kind:N", "run:N", "count:Q", alt.Tooltip("share:Q", format=".1%")],
        )
    )
    return _spec(chart, 2 * len(values))


def reliability_chart(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, Any] | None:
    """Plot observed success rates over predicted probabilities, with intervals; None without probabilities."""
    if not rows:
        return None
    alt = _altair()
    values = [{**row, "run": names[row["run"]]} for row in rows]
    runs = list(dict.fromkeys(value["run"] for value in values))
    shares, whole = alt.Axis(format=".0%"), alt.Scale(domain=[0, 1])
    across = alt.X("stated:Q", title="predicted probability of success", scale=whole, axis=shares)
    tips = [alt.Tooltip("run:N"), alt.Tooltip("trials:Q")]
    tips += [alt.Tooltip(f"{name}:Q", format=".1%") for name in ("stated", "rate", "low", "high")]
    base = alt.Chart(alt.Data(values=values)).encode(across, color=_colour(alt, names, runs), tooltip=tips)
    up = alt.Y("rate:Q", title="success rate", scale=whole, axis=shares)
    diagonal = alt.Chart(alt.Data(values=[{"stated": 0, "rate": 0}, {"stated": 1, "rate": 1}]))
    diagonal = diagonal.mark_line(strokeDash=[4, 4], color="#888888", strokeWidth=1).encode(across, up)
    lines = base.mark_line(strokeWidth=1).encode(up)
    errors = base.mark_rule().encode(alt.Y("low:Q", title="success rate"), alt.Y2("high:Q"))
    size = alt.Size("trials:Q", scale=alt.Scale(range=[30, 220]), legend=None)
    points = base.mark_point(filled=True, opacity=1).encode(up, size)
    return _spec(alt.layer(diagonal, lines, errors, points))


def comparison_chart(pairs: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, Any] | None:
    """Plot differences of success rates on common trials, with their intervals; None without any."""
    if not pairs:
        return None
    alt = _altair()
    values = [
        {
            "pair": f"{names[pair['second']]} − {names[pair['first']]}",
            **dict(zip(("difference", "low", "high"), pair["difference"], strict=True)),
            "trials": pair["trials"],
        }
        for pair in pairs
    ]
    tips = [alt.Tooltip("pair:N"), alt.Tooltip("trials:Q")]
    tips += [alt.Tooltip(f"{name}:Q", format="+.1%") for name in ("difference", "low", "high")]
    title = "difference of success rates"
    axis = alt.Axis(format="+.0%")
    base = alt.Chart(alt.Data(values=values)).encode(
        alt.Y("pair:N", sort=None, title=None, axis=alt.Axis(labelLimit=260)), tooltip=tips
    )
    zero = alt.Chart(alt.Data(values=[{"x": 0}])).mark_rule(strokeDash=[4, 4], color="#888888").encode(x="x:Q")
    lines = base.mark_rule(strokeWidth=1.5).encode(alt.X("low:Q", title=title, axis=axis), x2="high:Q")
    points = base.mark_point(filled=True, size=45, opacity=1).encode(alt.X("difference:Q", axis=axis))
    return _spec(alt.layer(zero, lines, points), 2 * len(values))


def curve_charts(runs: Sequence[ReportRun], names: Sequence[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Plot each measure of the trainings over their steps: yields its name and the chart."""
    alt = _altair()
    measures: dict[str, list[dict[str, Any]]] = {}
    for run, name in zip(runs, names, strict=True):
        for curve in run.curves:
            line = f"{name}: {curve.training}" if curve.training else name
            points = zip(curve.steps, curve.values, strict=True)
            # Five digits are more than a pixel shows.
            values = [{"step": step, "value": float(f"{value:.5g}"), "run": line} for step, value in points]
            measures.setdefault(curve.measure, []).extend(values)
    for measure, values in measures.items():
        lines = list(dict.fromkeys(str(value["run"]) for value in values))
        chart = (
            alt.Chart(alt.Data(values=values))
            .mark_line(strokeWidth=1.3, point={"size": 12} if len(values) <= 60 * len(lines) else False)
            .encode(
                alt.X("step:Q", title="step"),
                alt.Y("value:Q", title=None, scale=alt.Scale(zero=False)),
                color=_colour(alt, lines),
                tooltip=["run:N", "step:Q", "value:Q"],
            )
        )
        yield measure, _spec(chart)
