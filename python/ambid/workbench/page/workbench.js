// The page: what is clicked is sent, what comes back is shown. All numbers are the server's.
"use strict";

const POLL_MS = 200;
const SETTLE_MS = 120, LET_GO_MS = 400;
const MEASURED = { color: "#9a9a9a", width: 4 }, SIMULATED = { color: "#a32a00", width: 1.4 };
const chosen = { channel: null, band: null, records: { training: 0, validation: null }, windows: {} };
let base = "", view = null, shown = null;

const $ = (id) => document.getElementById(id);
const text = (value, digits = 4) => (value === null || value === undefined ? "–" : String(Number(value.toPrecision(digits))));
const misfitText = (value) => (value === null ? "–" : value < 10 ? value.toFixed(3) : value.toPrecision(4));

function element(tag, options = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(options)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name in made && name !== "list") made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

// ---- calls

async function answer(response) {
  const found = await response.json().catch(() => ({ error: `the server answers ${response.status}` }));
  if (!response.ok) throw new Error(found.error ?? `the server answers ${response.status}`);
  return found;
}

async function ask(call, given = {}) {
  return answer(await fetch(`${base}/${call}?${new URLSearchParams(given)}`));
}

async function post(path, given = {}) {
  return answer(await fetch(path, {
    method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(given),
  }));
}

function tell(error) {
  const lost = error instanceof TypeError ? "the server does not answer; is the command still running?" : error.message;
  $("error").textContent = lost;
  $("error").hidden = !lost;
}

let last = Promise.resolve();

// One step after the other: each is taken on the step that the page shows.
function step(call, given = {}) {
  last = last.then(() => taken(call, given));
  return last;
}

async function taken(call, given) {
  tell({ message: "" });
  try {
    await show(await post(`${base}/${call}`, { revision: view.revision, ...given }));
  } catch (error) {
    tell(error);
    await show(await ask("view"));
  }
}

// ---- the present step

async function show(next) {
  const isNew = next.revision !== shown;
  view = next;
  showJob();
  if (isNew) {
    shown = view.revision;
    showHead();
    showSteps();
    showParameters();
    const isFirst = chosen.channel === null;  // then the worst cell says which channel the charts show
    await fresh("candidates-section", showCandidates());
    await Promise.all([fresh("where", showMaps()), ...(isFirst ? [] : [fresh("signals", showCharts())])]);
    chosen.channel ??= view.records[0].channels[0].channel;
    showChosen();
    if (isFirst) await fresh("signals", showCharts());
  }
  if (view.job?.running) setTimeout(async () => { try { await show(await ask("view")); } catch (e) { tell(e); } }, POLL_MS);
  else await concluded();
}

async function fresh(section, shown) {
  $(section).classList.add("stale");
  $(section).setAttribute("aria-busy", "true");
  try {
    await shown;
    $(section).classList.remove("stale");
    $(section).removeAttribute("aria-busy");
  } catch (error) {
    tell(error);
  }
}

let heard = null;

async function concluded() {
  const job = view.job;
  if (job === null || heard === job.number) return;
  heard = job.number;
  if (job.error) tell({ message: job.error });
  else if (job.what === "report") await download("report.html");
}

function showJob() {
  const job = view.job, running = Boolean(job?.running);
  $("job").hidden = !running;
  if (running) {
    $("doing").textContent = job.total ? `${job.doing}, ${job.done + 1} of ${job.total}` : `${job.doing} ${job.done || ""}`;
    if (job.total) { $("progress").max = job.total; $("progress").value = job.done; } else $("progress").removeAttribute("value");
  }
  document.body.setAttribute("aria-busy", String(running));
  for (const own of document.querySelectorAll("[data-step]")) own.disabled = running || own.dataset.step === "no";
}

function showHead() {
  $("rig").textContent = view.rig;
  document.title = `${view.rig} · ambid workbench`;
  $("effects").replaceChildren(view.effects.length ? "with " : "no effects added", ...view.effects.map((own) => element(
    "span", {}, `${own.name} `, element("button", {
      type: "button", title: own.physics, "aria-label": `remove ${own.name}`, "data-step": "yes",
      onclick: () => step("remove", { name: own.name }),
    }, "Remove"), " ")));
  const mark = (value) => (value === null ? "" : value <= view.bound ? " ✓" : " ✗");
  $("misfit").textContent = misfitText(view.misfit) + mark(view.misfit);
  $("validation").textContent = view.validation_misfit === null ? "none" : misfitText(view.validation_misfit) + mark(view.validation_misfit);
  $("bound").textContent = text(view.bound, 3);
  $("undo").dataset.step = view.can_undo ? "yes" : "no";
  $("rank").dataset.step = view.fitted ? "yes" : "no";
  $("fit").dataset.step = "yes";
  const names = view.records[0].channels.map((own) => own.channel);
  $("channel").replaceChildren(...names.map((name) => element("option", { value: name }, name)));
  $("notes").replaceChildren(...view.notes.map((note) => element("li", {}, note)));
}

function showSteps() {
  const rows = view.steps.map((own) => element("tr", {}, element("th", { scope: "row" }, own.did),
    ...[own.predicted_misfit, own.misfit, own.validation_misfit].map((value) => element("td", { className: "number" }, misfitText(value)))));
  $("steps").tBodies[0].replaceChildren(...rows);
  const x = view.steps.map((_, k) => k + 1);
  const traces = [
    { x, y: view.steps.map((own) => own.misfit), name: "training", mode: "lines+markers", line: { color: "#1f4e8c", width: 2 }, marker: { symbol: "circle", size: 8 } },
    { x, y: view.steps.map((own) => own.validation_misfit), name: "validation", mode: "lines+markers", line: { color: "#c05a00", width: 2, dash: "dash" }, marker: { symbol: "diamond-open", size: 10 } },
  ].filter((own) => own.y.some((value) => value !== null));
  draw($("staircase"), traces, {
    xaxis: { title: { text: "step" }, dtick: 1, range: [0.7, x.length + 0.3] },
    yaxis: { title: { text: "misfit" }, type: "log", exponentformat: "power", dtick: 1 },
    shapes: [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: view.bound, y1: view.bound, line: { dash: "dot", color: "#555", width: 1 } }],
  });
}

// ---- candidates

async function showCandidates() {
  const found = await ask("candidates"), rows = found.candidates;
  $("ranking-hint").textContent = rows.length
    ? `The bar stands between noise and the present misfit, ${misfitText(view.misfit)}, on a logarithmic scale. Adding fits all parameters.`
    : view.fitted ? "Rank the candidates to see what each would bring." : "Fit first: candidates are judged where a fit has ended.";
  $("candidates").hidden = !rows.length;
  $("candidates").tBodies[0].replaceChildren(...rows.map((own) => element("tr", { className: own.significant ? "" : "may-be-chance" },
    element("td", {}, element("details", {}, element("summary", {}, own.effect), element("p", {}, own.physics), element("p", {}, own.signature),
      element("p", {}, "predicted: " + Object.entries(own.predicted_value).map(([name, value]) => `${name} ${text(value, 3)}`).join(", ")),
      ...(own.confusable_with.length ? [element("p", {}, `hardly told from ${own.confusable_with.join(", ")}`)] : []))),
    element("td", { className: "number" }, bar(own.left), ` ${misfitText(own.predicted_misfit)}`),
    element("td", { className: "number" }, own.significant ? own.chance : `${own.chance}, may be chance`),
    element("td", {}, element("button", { type: "button", "data-step": "yes", "aria-label": `add ${own.effect}`, onclick: () => step("add", { name: own.effect }) }, "Add")))));
  const not = Object.entries(found.not_tried);
  $("not-tried").hidden = !not.length;
  $("not-tried").lastElementChild.replaceChildren(...not.map(([name, why]) => element("li", {}, `${name}: ${why}`)));
  showJob();
}

function bar(share) {
  const filled = element("span");
  filled.style.width = `${100 * share}%`;
  return element("span", { className: "bar", "aria-hidden": "true" }, filled);
}

// ---- the map

async function showMaps() {
  const found = await ask("where");
  $("sentence").textContent = found.sentence;
  chosen.channel ??= found.worst?.channel ?? null;
  $("maps").replaceChildren(...found.maps.map((own, k) => mapTable(own, k)));
  showChosen();
}

function mapTable(own, k) {
  const bands = own.cells[0].map((_, b) => [own.edges_hz[b], own.edges_hz[b + 1]]);
  const head = element("tr", {}, element("th", { scope: "col" }, "Hz"), ...bands.map((band) => element("th", { scope: "col" }, text(band[0], 2))));
  const rows = own.channels.map((channel, r) => element("tr", {}, element("th", { scope: "row" }, channel), ...bands.map((band, c) => {
    const cell = own.cells[r][c];
    return element("td", {}, element("button", {
      type: "button", className: `level-${cell.level}`, tabIndex: r || c ? -1 : 0, "data-row": r, "data-column": c,
      "data-channel": channel, "data-low": band[0],
      "aria-label": `${channel}, ${text(band[0], 3)} to ${text(band[1], 3)} Hz, misfit ${cell.text || "not measured"}`,
      onclick: () => choose(channel, band, k), onkeydown: walk,
    }, cell.text));
  })));
  const role = view.records[k].role;
  return element("table", { className: "map", "data-record": k }, element("caption", {}, `${role}: ${own.record}`),
    element("thead", {}, head), element("tbody", {}, ...rows));
}

function walk(event) {
  const by = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] }[event.key];
  if (!by) return;
  event.preventDefault();
  const at = event.target, table = at.closest("table");
  const next = table.querySelector(`[data-row="${+at.dataset.row + by[0]}"][data-column="${+at.dataset.column + by[1]}"]`);
  if (!next) return;
  at.tabIndex = -1;
  next.tabIndex = 0;
  next.focus();
}

async function choose(channel, band, record) {
  if (channel !== chosen.channel) chosen.windows = {};
  chosen.channel = channel;
  chosen.band = band;
  if (record !== undefined) chosen.records[view.records[record].role] = record;
  showChosen();
  await showCharts();
}

function showChosen() {
  $("channel").value = chosen.channel;
  $("band").textContent = chosen.band ? `${text(chosen.band[0], 3)} .. ${text(chosen.band[1], 3)} Hz` : "all";
  $("clear-band").disabled = !chosen.band;
  for (const cell of document.querySelectorAll(".map button")) {
    const is = cell.dataset.channel === chosen.channel && chosen.band !== null && +cell.dataset.low === chosen.band[0];
    cell.setAttribute("aria-pressed", String(is));
  }
}

// ---- charts

function draw(where, traces, layout) {
  return Plotly.react(where, traces, {
    margin: { l: 62, r: 12, t: 8, b: 42 }, font: { size: 12 }, paper_bgcolor: "#fff", plot_bgcolor: "#fff",
    legend: { traceorder: "normal", orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, ...layout,
  }, { displaylogo: false, responsive: true, modeBarButtonsToRemove: ["select2d", "lasso2d", "toImage"], scrollZoom: false });
}

const roles = () => ["training", "validation"].filter((role) => view.records.some((own) => own.role === role));

function recordOf(role) {
  const own = chosen.records[role];
  return own !== null && view.records[own]?.role === role ? own : view.records.findIndex((one) => one.role === role);
}

// Where the charts of a record stand, what makes the panel of one, and what draws it.
const CHARTS = [["overlays", overlayPanel, showOverlay], ["spectra", spectrumPanel, showSpectrum]];

async function showCharts() {
  for (const [place, make] of CHARTS) {
    if ($(place).childElementCount !== roles().length) $(place).replaceChildren(...roles().map(make));
  }
  try {
    await Promise.all(roles().flatMap((role) => CHARTS.map(([, , show]) => show(role))));
  } catch (error) {
    tell(error);
  }
}

function overlayPanel(role) {
  const of = view.records.map((own, k) => [own, k]).filter(([own]) => own.role === role);
  const pick = element("select", { "aria-label": `${role} record`, onchange: (event) => {
    chosen.records[role] = +event.target.value;
    delete chosen.windows[role];
    showCharts();
  } }, ...of.map(([own, k]) => element("option", { value: k }, own.name)));
  const edge = (name) => element("input", { type: "number", step: "any", id: `${role}-${name}`, onchange: () => zoomTo(role, +$(`${role}-from`).value, +$(`${role}-to`).value) });
  return element("div", { className: "panel" }, element("h3", { id: `${role}-title` }, role),
    element("div", { className: "window" }, pick,
      element("label", {}, "from ", edge("from")), element("label", {}, "to ", edge("to")),
      element("button", { type: "button", onclick: () => { delete chosen.windows[role]; showOverlay(role); } }, "Worst stretch"),
      element("button", { type: "button", onclick: () => zoomTo(role, 0, view.records[recordOf(role)].span) }, "Whole record")),
    element("div", { className: "chart", id: `${role}-overlay`, role: "img", "aria-labelledby": `${role}-title` }));
}

function zoomTo(role, from, to) {
  chosen.windows[role] = [from, to];
  return showOverlay(role).catch(tell);
}

const latest = {};

async function newest(key, asked) {
  const mine = (latest[key] = (latest[key] ?? 0) + 1);
  const found = await asked;
  return latest[key] === mine ? found : null;
}

async function showOverlay(role) {
  const where = $(`${role}-overlay`), record = recordOf(role), span = chosen.windows[role];
  const found = await newest(`overlay ${role}`, ask("signals", {
    record, channel: chosen.channel, pixels: Math.max(50, where.clientWidth), ...(span ? { from: span[0], to: span[1] } : {}),
  }));
  if (!found) return;
  const { x, noise } = found, last = x[x.length - 1], isTime = found.x_unit === "s";
  $(`${role}-from`).value = x[0];
  $(`${role}-to`).value = last;
  $(`${role}-title`).textContent = `${role}: ${found.record}, ${found.channel}, fit ${text(found.fit_percent)} % of ${text(found.noise_ceiling_percent)} %`;
  const band = isTime
    ? [{ x: [x[0], last], y: [2 * noise[0], 2 * noise[0]], name: "noise, ±2 sigma", line: { color: "#5b7fa6", dash: "dot", width: 1 }, hoverinfo: "skip" },
       { x: [x[0], last], y: [-2 * noise[0], -2 * noise[0]], showlegend: false, fill: "tonexty", fillcolor: "rgba(140,175,215,.35)", line: { color: "#5b7fa6", dash: "dot", width: 1 }, hoverinfo: "skip" }]
    : [{ x, y: noise, name: "noise, sigma", line: { color: "#5b7fa6", dash: "dot" } }];
  const traces = [
    { x, y: found.measured, name: "measured", line: MEASURED },
    { x, y: found.simulated, name: "simulated", line: SIMULATED },
    ...(noise[0] === null ? [] : band).map((own) => ({ ...own, yaxis: "y2" })),
    { x, y: found.residual, name: "residual", yaxis: "y2", line: { color: "#000", width: 1 } },
  ].map((own) => ({ mode: "lines", ...own }));
  const scale = isTime ? "linear" : "log";
  await draw(where, traces, {
    hovermode: "x unified", uirevision: `${chosen.channel} ${record}`,
    xaxis: { title: { text: isTime ? "time [s]" : "frequency [Hz]" }, type: scale, anchor: "y2", zeroline: false, autorange: true },
    yaxis: { title: { text: `[${found.unit}]` }, domain: [0.42, 1], type: scale, zeroline: false, autorange: true },
    yaxis2: { title: { text: `residual [${found.unit}]` }, domain: [0, 0.36], type: scale, zeroline: false, autorange: true },
  });
  if (!where.listens) {
    where.listens = true;
    let settle = 0;
    where.on("plotly_relayout", (change) => {
      const from = change["xaxis.range[0]"], to = change["xaxis.range[1]"];
      if (from === undefined || $(`${role}-overlay`).layout.xaxis.type === "log") return;
      clearTimeout(settle);
      settle = setTimeout(() => zoomTo(role, from, to), SETTLE_MS);
    });
  }
}

function spectrumPanel(role) {
  return element("div", { className: "panel" }, element("h3", { id: `${role}-lines-title` }, role),
    element("div", { className: "chart", id: `${role}-lines`, role: "img", "aria-labelledby": `${role}-lines-title` }));
}

async function showSpectrum(role) {
  const where = $(`${role}-lines`);
  const found = await newest(`lines ${role}`, ask("lines", { record: recordOf(role), channel: chosen.channel, pixels: Math.max(50, where.clientWidth) }));
  if (!found) return;
  $(`${role}-lines-title`).textContent = `${role}: ${found.record}, ${chosen.channel}: power left on each line, in units of its noise`;
  const [low, high] = chosen.band ?? [];
  await draw(where, [{ x: found.frequency_hz, y: found.misfit, mode: "lines+markers", name: "misfit", line: { color: "#1f4e8c", width: 0.6 }, marker: { size: 3, color: "#1f4e8c" } }], {
    showlegend: false, hovermode: "x",
    xaxis: { title: { text: "frequency [Hz]" }, type: "log", autorange: true },
    yaxis: { title: { text: "misfit" }, type: "log", exponentformat: "power", dtick: 1, autorange: true },
    shapes: [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: 1, y1: 1, line: { dash: "dot", color: "#555" } },
      ...(chosen.band ? [{ type: "rect", yref: "paper", x0: low, x1: high, y0: 0, y1: 1, fillcolor: "rgba(224,135,0,.18)", line: { color: "#e08700", width: 1 } }] : [])],
  });
  if (!where.listens) {
    where.listens = true;
    const others = () => roles().filter((other) => other !== role).map((other) => $(`${other}-lines`));
    where.on("plotly_hover", (event) => {
      if (event.event) for (const other of others()) Plotly.Fx.hover(other, { xval: event.points[0].x }, "xy");
    });
    where.on("plotly_unhover", () => { for (const other of others()) Plotly.Fx.unhover(other); });
  }
}

// ---- parameters

function moved(own) {
  if (own.was === null || own.was === own.value) return "–";
  const by = own.moved_by_std_errors === null ? "" : `${text(own.moved_by_std_errors, 3)} std errors `;
  return `${by}from ${text(own.was, 6)}`;
}

let letGo = 0;

function showParameters() {
  const held = document.activeElement?.closest("#parameters") ? document.activeElement.getAttribute("aria-label") : null;
  $("preview").textContent = "";
  $("parameters").tBodies[0].replaceChildren(...view.parameters.map((own) => {
    const move = (event) => {
      const value = Number(event.target.value);
      clearTimeout(letGo);  // keys may move on
      letGo = setTimeout(() => step("move", { name: own.name, value }), LET_GO_MS);
    };
    const number = element("input", { type: "number", step: "any", value: text(own.value, 7), "aria-label": `${own.name}, value`, "data-step": "yes", onchange: move });
    return element("tr", {}, element("th", { scope: "row" }, own.name),
      element("td", {}, element("input", {
        type: "range", min: own.low, max: own.high, step: "any", value: own.value, "aria-label": own.name, "data-step": "yes",
        onchange: move, oninput: (event) => { number.value = event.target.value; preview(own, event.target); },
      })),
      element("td", {}, number), element("td", {}, own.unit),
      element("td", { className: "number" }, own.ci95 ? `${text(own.ci95[0], 6)} .. ${text(own.ci95[1], 6)}` : "–"),
      element("td", { className: "number" }, moved(own)));
  }));
  showJob();
  if (held) $("parameters").querySelector(`[aria-label=${CSS.escape(held)}]`)?.focus();
}

let asking = false, wanted = null;

async function preview(own, slider) {
  wanted = { name: own.name, value: slider.value };
  if (asking) return;
  asking = true;
  while (wanted) {
    const now = wanted;
    wanted = null;
    try {
      const found = await ask("preview", now);
      const kept = found.validation_misfit === null ? "" : `, validation ${misfitText(found.validation_misfit)}`;
      $("preview").textContent = `${now.name} = ${text(Number(now.value), 5)} ${own.unit}: training ${misfitText(found.misfit)}${kept}`;
      slider.setAttribute("aria-valuetext", `${text(Number(now.value), 5)} ${own.unit}, misfit ${misfitText(found.misfit)}`);
    } catch (error) {
      $("preview").textContent = `${now.name} = ${text(Number(now.value), 5)} ${own.unit}: ${error.message}`;
    }
  }
  asking = false;
}

// ---- taking away

async function download(name) {
  const response = await fetch(`${base}/${name}`);
  if (!response.ok) return tell(new Error((await response.json()).error));
  const link = element("a", { href: URL.createObjectURL(await response.blob()), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// ---- the beginning

async function begin() {
  const kept = sessionStorage.getItem("window");  // a reload goes on where it was
  base = `windows/${kept}`;
  let first = kept ? await ask("view").catch(() => null) : null;
  if (!first) {
    const { window: name } = await post("windows");
    sessionStorage.setItem("window", name);
    base = `windows/${name}`;
    first = await ask("view");
  }
  heard = first.job && !first.job.running ? first.job.number : null;
  await show(first);
}

$("fit").onclick = () => step("fit");
$("rank").onclick = () => step("rank");
$("undo").onclick = () => step("undo");
$("cancel").onclick = () => post(`${base}/cancel`).catch(tell);
$("channel").onchange = (event) => choose(event.target.value, chosen.band);
$("clear-band").onclick = () => choose(chosen.channel, null);
$("export-python").onclick = () => download("workbench.py");
$("export-model").onclick = () => download("model.json");
$("export-report").onclick = () => step("report");
$("export-report").dataset.step = "yes";
begin().catch(tell);
