// The page of a report: tables that sort and filter, the facts of each run, charts, pictures. All charts are drawn at once:
// a printed page has no scrolling. Texts of runs are set as text, never as HTML.
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const main = document.getElementById("main");

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else made.setAttribute(name, value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

function section(id, title, ...children) {
  document.getElementById("nav").append(element("a", { href: `#${id}` }, title));
  const made = element("section", { id }, element("h2", {}, title), ...children);
  main.append(made);
  return made;
}

const percent = (value, digits = 1) => `${(100 * value).toFixed(digits)} %`;

// Wilson's 95 % interval, as graspbox.evaluation.wilson computes it.
function wilson(succeeded, trials) {
  const z = 1.959963984540054, rate = succeeded / trials, weight = (z * z) / trials;
  const center = (rate + weight / 2) / (1 + weight);
  const half = (z / (1 + weight)) * Math.sqrt((rate * (1 - rate)) / trials + weight / (4 * trials));
  return [succeeded === 0 ? 0 : center - half, succeeded === trials ? 1 : center + half];
}

// A table of rows; columns have title, value (for sorting), cell (fills a td) and kind ("text", "number" or "rate").
class Table {
  constructor(id, columns, pageSize) {
    this.columns = columns; this.pageSize = pageSize; this.rows = []; this.page = 0; this.sorted = null; this.up = true;
    this.heads = columns.map((column, index) => element("th", { scope: "col", class: column.kind, "aria-sort": "none" },
      element("button", { type: "button", onclick: () => this.sort(index) }, column.title)));
    this.body = element("tbody");
    this.range = element("span");
    this.back = element("button", { type: "button", onclick: () => this.turn(-1) }, "back");
    this.next = element("button", { type: "button", onclick: () => this.turn(1) }, "next");
    this.pages = element("div", { class: "pages" }, this.back, this.range, this.next);
    const table = element("table", { id }, element("thead", {}, element("tr", {}, ...this.heads)), this.body);
    this.element = element("div", {}, element("div", { class: "scroll" }, table), this.pages);
  }
  show(rows) { this.rows = rows; this.page = 0; this.order(); }
  sort(index) {
    this.up = this.sorted === index ? !this.up : this.columns[index].kind === "text";
    this.sorted = index; this.page = 0; this.order();
  }
  order() {
    this.shown = [...this.rows];
    if (this.sorted !== null) {
      const value = this.columns[this.sorted].value, sign = this.up ? 1 : -1;
      this.shown.sort((a, b) => {
        const x = value(a), y = value(b);
        if (x === null || y === null) return (x === null) - (y === null);
        return sign * (typeof x === "string" ? x.localeCompare(y, "en", { numeric: true }) : x - y);
      });
    }
    this.heads.forEach((head, index) => head.setAttribute("aria-sort",
      index !== this.sorted ? "none" : this.up ? "ascending" : "descending"));
    this.fill();
  }
  turn(step) { this.page += step; this.fill(); }
  fill() {
    const first = this.page * this.pageSize, some = this.shown.slice(first, first + this.pageSize);
    this.body.replaceChildren(...some.map((row) => element("tr", {}, ...this.columns.map((column) => {
      const cell = element("td", { class: column.kind + (column.long ? " long" : "") });
      column.cell(cell, row);
      return cell;
    }))));
    const last = first + some.length;
    this.range.textContent = `${some.length ? first + 1 : 0} to ${last} of ${this.shown.length}`;
    this.back.disabled = this.page === 0; this.next.disabled = last >= this.shown.length;
    this.pages.hidden = this.shown.length <= this.pageSize;
  }
}

const plain = (title, value, kind = "text", long = false) =>
  ({ title, value, kind, long, cell: (cell, row) => { cell.textContent = value(row) ?? ""; } });

function rateColumn(title, field) {
  return { title, kind: "rate", value: (row) => row[field]?.[0] ?? null, cell: (cell, row) => {
    if (!row[field]) return;
    const [rate, low, high] = row[field];
    if (field === "secure") cell.classList.add("secure");
    cell.style.setProperty("--rate", rate);
    cell.append(`${percent(rate)} `, element("small", {}, `${(100 * low).toFixed(1)} to ${(100 * high).toFixed(1)}`));
  } };
}

function facts(run) {
  const rows = Object.entries(run.facts), short = rows.filter(([, value]) => value.length <= 160);
  const list = element("dl", {}, ...[["kind", run.kind], ["file", run.path], ...short].flatMap(([name, value]) =>
    [element("dt", {}, name), element("dd", {}, name === "command" ? element("code", {}, value) : value)]));
  const long = rows.filter(([, value]) => value.length > 160).map(([name, value]) =>
    element("details", {}, element("summary", {}, name), element("code", {}, value)));
  const refused = Object.entries(run.refused);
  if (refused.length) {
    long.push(element("details", {}, element("summary", {}, `${refused.length} objects cannot be used`),
      ...refused.slice(0, 50).map(([name, why]) => element("p", {}, `${name}: ${why}`))));
  }
  return element("div", { class: "run" }, element("h3", {}, run.name), list, ...long);
}

const select = (title, id, choices, changed) => element("label", {}, title, element("select", { id, onchange: changed },
  ...choices.map(([value, text]) => element("option", { value }, text))));
const chosen = (id) => document.getElementById(id)?.value ?? "";

function tables() {
  const { trials, summary, runs } = data;
  const kinds = [...new Set([...trials.kinds, ...summary.flatMap((row) => Object.keys(row.failures))])]
    .filter((kind) => kind).sort();
  const classesOf = new Map(summary.filter((row) => row.group === "object").map((row) => [row.name, row.classes]));
  const several = data.summary.some((row) => row.run !== data.summary[0].run);
  const update = () => show();
  const filters = element("div", { class: "filters" },
    select("show", "group", [["run", "runs"], ["class", "classes of objects"], ["object", "objects"]], update),
    select("run", "run", [["", "all"], ...runs.map((run, i) => [`${i}`, run.name]).filter(([i]) =>
      summary.some((row) => `${row.run}` === i))], update),
    element("label", {}, "object", element("input", { id: "object", placeholder: "any part of its name", oninput: update })),
    select("class", "class", [["", "all"], ...data.classes.map(([name, meaning]) => [name, `${name}: ${meaning}`])], update),
    select("failure", "failure", [["", "all"], ...kinds.map((kind) => [kind, kind])], update),
    element("button", { type: "button", id: "clear", onclick: () => {
      for (const id of ["run", "object", "class", "failure"]) document.getElementById(id).value = "";
      show();
    } }, "clear"));
  const overall = new Table("summary-table", [
    ...(several ? [plain("run", (row) => runs[row.run].name, "text", true)] : []),
    plain("objects", (row) => (row.group === "run" ? "all" : row.name), "text", true),
    plain("trials", (row) => row.trials, "number"),
    rateColumn("success", "success"), rateColumn("secure", "secure"),
    ...kinds.map((kind) => plain(kind, (row) => row.failures[kind] ?? 0, "number")),
  ], 25);
  section("summary", "Success", element("p", {},
    "Rates with Wilson 95 % intervals. Click a column to sort; filters apply to both tables."),
    filters, overall.element);
  const count = trials.run.length, countLine = element("p", { id: "count", class: "count" });
  const outcomes = ["failure", "success", "secure"];
  const each = new Table("trials-table", [
    ...(several ? [plain("run", (i) => runs[trials.run[i]].name, "text", true)] : []),
    plain("object", (i) => trials.objects[trials.object[i]], "text"),
    plain("outcome", (i) => outcomes[trials.outcome[i]], "text"),
    plain("failure", (i) => trials.kinds[trials.kind[i]], "text"),
    ...(trials.p.some((p) => p !== null) ? [plain("predicted", (i) => trials.p[i], "number")] : []),
    plain("trial", (i) => trials.key[i], "text"),
  ], 15);
  if (count) {
    const more = Object.entries(trials.left_out).map(([run, n]) => `${n} more of ${runs[run].name}`);
    section("trials", "Trials", countLine, each.element, more.length
      ? element("p", {}, `The table holds the first trials of each run; the rates above count all: ${more.join(", ")}.`) : null);
  }
  function show() {
    const group = chosen("group"), run = chosen("run"), kind = chosen("failure"), klass = chosen("class");
    const part = chosen("object").toLowerCase();
    const fits = (name, classes) => name.toLowerCase().includes(part) && (!klass || classes.includes(klass));
    overall.show(summary.filter((row) => row.group === group && (!run || `${row.run}` === run)
      && (!kind || (row.failures[kind] ?? 0) > 0) && (row.group !== "object" || fits(row.name, row.classes))
      && (row.group !== "class" || !klass || row.name === klass)));
    if (!count) return;
    const objects = trials.objects.map((name) => fits(name, classesOf.get(name) ?? []));
    const rows = [];
    let won = 0;
    for (let i = 0; i < count; i += 1) {
      if (objects[trials.object[i]] && (!run || `${trials.run[i]}` === run)
          && (!kind || trials.kinds[trials.kind[i]] === kind)) {
        rows.push(i);
        won += trials.outcome[i] > 0;
      }
    }
    const [low, high] = rows.length ? wilson(won, rows.length) : [0, 0];
    countLine.textContent = rows.length ? `${rows.length} of ${count} trials, ${won} successes: ${percent(won / rows.length)} `
      + `(${percent(low)} to ${percent(high)})` : `0 of ${count} trials`;
    each.show(rows);
  }
  show();
}

function comparisons() {
  const name = (index) => data.runs[index].name, both = (pair, i) => pair.rates[i];
  const table = new Table("pairs-table", [
    plain("run", (pair) => name(pair.first), "text", true), plain("other run", (pair) => name(pair.second), "text", true),
    plain("trials", (pair) => pair.trials, "number"),
    rateColumn("run", "first_rate"), rateColumn("other", "second_rate"),
    plain("only run", (pair) => pair.only[0], "number"), plain("only other", (pair) => pair.only[1], "number"),
    { title: "difference", kind: "number", value: (pair) => pair.difference[0], cell: (cell, pair) => {
      const [d, low, high] = pair.difference.map((v) => `${v > 0 ? "+" : ""}${(100 * v).toFixed(1)}`);
      cell.append(`${d} % `, element("small", {}, `${low} to ${high}`));
    } },
    { title: "p", kind: "number", value: (pair) => pair.p,
      cell: (cell, pair) => { cell.textContent = pair.p < 0.001 ? "< 0.001" : pair.p.toFixed(3); } },
  ], 60);
  section("comparison", "Common trials", element("p", {}, "Success on the trials that two runs have in common: same seed "
    + "and object, same pose, or same row. Only run, only other: trials in which only one of them succeeded. Differences (other minus "
    + "run) have 95 % intervals for paired trials (Newcombe); p is McNemar's exact test."), table.element);
  table.show(data.pairs.map((pair) => ({ ...pair, first_rate: both(pair, 0), second_rate: both(pair, 1) })));
}

function charts(id, title, note, some) {
  section(id, title, note ? element("p", {}, note) : null, element("div", { class: "charts" }, ...some.map((chart) =>
    element("div", {}, element("h3", {}, chart.title), element("div", { class: "chart", "data-chart": chart.index })))));
}

function failures() {
  section("failures", "Failures", element("p", {},
    "Trials run again and rendered: hand and object at the end, and before it when the hand has closed, where two are shown."),
    element("div", { class: "pictures" }, ...data.pictures.map((row) => element("figure", {},
      row.images ? element("div", { class: "images" }, ...row.images.map((image) => element("img", {
        src: `data:image/webp;base64,${image}`, alt: `${row.object}: ${row.failure}`, loading: "lazy" }))) : null,
      element("figcaption", {}, element("b", {}, `${row.failure}: ${row.object}`), element("br"),
        element("span", {}, [data.runs[row.run].name, row.trial,
          row.error ? `cannot be shown: ${row.error}`
            : row.now !== row.failure ? `run again it ends as: ${row.now || "success"}` : ""].filter((t) => t).join("; ")))))));
}

function theme(dark) {
  const ink = dark ? "#e4e8ef" : "#1d2430", soft = dark ? "#9aa4b2" : "#5b6472", line = dark ? "#333b47" : "#d9dee6";
  const range = dark ? ["#6cb8ea", "#f0a35e", "#4fcaa0", "#e6a3cb", "#e9d66b", "#a9b4ff", "#c4c4c4", "#d98880"]
    : ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b58900", "#56b4e9", "#555555", "#8c6d1f"];
  return { background: null, font: "system-ui, sans-serif", view: { stroke: line }, range: { category: range },
    mark: { color: range[0] }, rule: { color: range[0] },
    axis: { labelColor: soft, titleColor: soft, gridColor: line, domainColor: line, tickColor: line, titleFontWeight: "normal" },
    legend: { labelColor: ink, titleColor: soft } };
}

// Vega's expressions are interpreted (`ast`): the page's policy forbids to compile any.
function draw(place) {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  vegaEmbed(place, data.charts[place.dataset.chart].spec, { ast: true, actions: false, renderer: "svg", config: theme(dark),
    tooltip: { theme: dark ? "dark" : "light" } }).catch((error) => { place.textContent = `chart: ${error.message}`; });
}

function build() {
  document.getElementById("made").textContent = data.made;
  section("runs", "Runs", element("div", { class: "runs" }, ...data.runs.map(facts)));
  if (data.summary.length) tables();
  if (data.pairs.length) comparisons();
  const indexed = data.charts.map((chart, index) => ({ ...chart, index }));
  const rates = indexed.filter((chart) => chart.group === "rates"), curves = indexed.filter((chart) => chart.group === "curves");
  if (rates.length) charts("charts", "Charts", data.note, rates);
  if (curves.length) charts("curves", "Training", "", curves);
  if (data.pictures.length) failures();
  document.documentElement.dataset.ready = "yes";
}

function start() {
  const places = document.querySelectorAll(".chart");
  places.forEach(draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => places.forEach(draw));
}
build();
