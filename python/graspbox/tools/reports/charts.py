"""Charts of a report, made with Vega-Altair as Vega-Lite specifications; the page gives them colours and width."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

from graspbox._common.imports import imported
from graspbox.tools.reports.runs import SHARES, ReportRun

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
    """Return a chart as a specification with its size and the rules of all charts."""
    sized = chart.properties(width="container", height=_HEIGHT if rows is None else max(rows, 2) * _STEP + 20)
    made: dict[str, Any] = sized.to_dict()
    # The page has the colours of both themes.
    made.pop("config", None)
    made["autosize"] = {"type": "fit-x", "contains": "padding"}
    return made


def _base(values: Sequence[Mapping[str, Any]], tips: Mapping[str, str | None], **encoding: Any) -> Any:
    """Make a chart of rows; `tips` maps the columns of its tooltip to formats, and to None those of text or counts."""
    alt = _altair()
    tooltip = []
    for name, form in tips.items():
        kind = "N" if isinstance(values[0][name], str) else "Q"
        tooltip.append(alt.Tooltip(f"{name}:{kind}", format=form or alt.Undefined))
    return alt.Chart(alt.Data(values=list(values))).encode(tooltip=tooltip, **encoding)


def _runs(names: Sequence[str], shown: Sequence[str]) -> Any:
    """Encode the runs of rows as colours, the same in all charts; the legend lists those that are shown."""
    alt = _altair()
    if len(names) < 2:
        return alt.Undefined
    options = {"orient": "bottom", "direction": "vertical", "title": None, "labelLimit": 330, "symbolLimit": 40}
    legend = alt.Legend(**options, values=list(shown))
    return alt.Color("run:N", sort=None, scale=alt.Scale(domain=list(names)), legend=legend)


def _offset(runs: Sequence[str]) -> Any:
    """Place the runs of a row one below the other."""
    alt = _altair()
    return alt.YOffset("run:N", sort=list(runs)) if len(runs) > 1 else alt.Undefined


def _distinct(values: Sequence[Mapping[str, Any]], column: str) -> list[str]:
    return list(dict.fromkeys(value[column] for value in values))


def _intervals(base: Any, column: str, title: str, **options: Any) -> list[Any]:
    """Plot a column across as points, and lines from ``low`` to ``high``."""
    alt = _altair()
    points = base.mark_point(filled=True, size=45, opacity=1).encode(alt.X(f"{column}:Q", title=title, **options))
    lines = base.mark_rule(strokeWidth=1.5).encode(alt.X("low:Q", title=title), alt.X2("high:Q"))
    return [lines, points]


def rate_chart(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, Any]:
    """Plot success rates with their intervals: a line for each name, a point for each run.

    `rows` are those of `graspbox.tools.reports.tables.summary_rows`, in the order of the lines; `names` are the runs'.
    """
    alt = _altair()
    values = [
        {"name": row["name"], "run": names[row["run"]], "trials": row["trials"], **_interval("rate", row["success"])}
        for row in rows
    ]
    lines, runs = _distinct(values, "name"), _distinct(values, "run")
    tips = {"name": None, "run": None, "trials": None, "rate": ".1%", "low": ".1%", "high": ".1%"}
    down = alt.Y("name:N", sort=lines, title=None)
    base = _base(values, tips, y=down, color=_runs(names, runs), yOffset=_offset(runs))
    domain, axis = alt.Scale(domain=[0, 1]), alt.Axis(format=".0%")
    marks = _intervals(base, "rate", "success rate", scale=domain, axis=axis)
    return _spec(alt.layer(*marks), max(len(values), 2 * len(lines)))


def _interval(name: str, values: Sequence[float]) -> dict[str, float]:
    return dict(zip((name, "low", "high"), values, strict=True))


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
    across = alt.X("share:Q", title="share of trials", axis=alt.Axis(format=".0%"))
    encoding = {"x": across, "y": alt.Y("kind:N", title=None), "yOffset": _offset(runs), "color": _runs(names, runs)}
    base = _base(values, {"kind": None, "run": None, "count": None, "share": ".1%"}, **encoding)
    return _spec(base.mark_bar(), 2 * len(values))


def reliability_chart(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, Any] | None:
    """Plot observed success rates over predicted probabilities, with intervals; None without probabilities."""
    if not rows:
        return None
    alt = _altair()
    values = [{**row, "run": names[row["run"]]} for row in rows]
    shares, whole = alt.Axis(format=".0%"), alt.Scale(domain=[0, 1])
    across = alt.X("stated:Q", title="predicted probability of success", scale=whole, axis=shares)
    up = alt.Y("rate:Q", title="success rate", scale=whole, axis=shares)
    tips = {"run": None, "trials": None, **dict.fromkeys(("stated", "rate", "low", "high"), ".1%")}
    base = _base(values, tips, x=across, color=_runs(names, _distinct(values, "run")))
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
            **_interval("difference", pair["difference"]),
            "trials": pair["trials"],
        }
        for pair in pairs
    ]
    tips = {"pair": None, "trials": None, **dict.fromkeys(("difference", "low", "high"), "+.1%")}
    base = _base(values, tips, y=alt.Y("pair:N", sort=None, title=None, axis=alt.Axis(labelLimit=260)))
    zero = alt.Chart(alt.Data(values=[{"x": 0}])).mark_rule(strokeDash=[4, 4], color="#888888").encode(x="x:Q")
    marks = _intervals(base, "difference", "difference of success rates", axis=alt.Axis(format="+.0%"))
    return _spec(alt.layer(zero, *marks), 2 * len(values))


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
        lines = _distinct(values, "run")
        scale, axis = alt.Scale(zero=False), alt.Undefined
        if measure in SHARES:
            scale, axis = alt.Scale(domain=[0, 1]), alt.Axis(format=".0%")
        encoding = {"x": alt.X("step:Q", title="step"), "y": alt.Y("value:Q", title=None, scale=scale, axis=axis)}
        base = _base(values, dict.fromkeys(("run", "step", "value")), **encoding, color=_runs(lines, lines))
        few = len(values) <= 60 * len(lines)
        yield measure, _spec(base.mark_line(strokeWidth=1.3, point={"size": 12} if few else False))
