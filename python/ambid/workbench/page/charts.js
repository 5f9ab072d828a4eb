// Charts over time: one channel, measured and simulated, and what is left. And how every chart is drawn.

import { look, newest, page } from "./calls.js";
import { chosen, recordOf } from "./choice.js";
import { newCursor } from "./cursor.js";
import { $, element, fresh, tell, text } from "./dom.js";

const SETTLE_MS = 120;
const told = {}, cursors = {};
export const MEASURED = { color: "#9a9a9a", width: 4 }, SIMULATED = { color: "#a32a00", width: 1.4 };
export const NOISE = { color: "#5b7fa6", dash: "dot", width: 1 }, SHADE = "rgba(140,175,215,.35)";
export const LOG = { type: "log", exponentformat: "power", autorange: true };

export const widthOf = (where) => Math.max(50, where.clientWidth);

export function draw(where, traces, layout) {
  return Plotly.react(where, traces, {
    margin: { l: 62, r: 12, t: 8, b: 42 }, font: { size: 12 }, paper_bgcolor: "#fff", plot_bgcolor: "#fff",
    legend: { traceorder: "normal", orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, ...layout,
  }, { displaylogo: false, responsive: true, modeBarButtonsToRemove: ["select2d", "lasso2d", "toImage"], scrollZoom: false });
}

export function overlayPanel(role) {
  const of = page.view.records.map((own, k) => [own, k]).filter(([own]) => own.role === role);
  const pick = element("select", { "aria-label": `${role} record`, id: `${role}-record` }, ...of.map(([own, k]) => element("option", { value: k }, own.name)));
  const edge = (name) => element("input", { type: "number", step: "any", id: `${role}-${name}`, onchange: () => zoomTo(role, +$(`${role}-from`).value, +$(`${role}-to`).value) });
  return element("div", { className: "panel" }, element("h3", { id: `${role}-title` }, role),
    element("div", { className: "window" }, pick,
      element("label", {}, "from ", edge("from")), element("label", {}, "to ", edge("to")),
      element("button", { type: "button", onclick: () => { delete chosen.windows[role]; renew(role); } }, "Worst stretch"),
      element("button", { type: "button", onclick: () => zoomTo(role, 0, page.view.records[recordOf(role)].span) }, "Whole record")),
    element("div", { className: "chart", id: `${role}-overlay`, role: "img", "aria-labelledby": `${role}-title` }),
    element("div", { className: "controls" }, element("label", { className: "grow" }, "cursor ", element("input", {
      id: `${role}-cursor`, type: "range", min: 0, max: 0, step: 1, value: 0, disabled: true, oninput: (event) => cursors[role].step(event),
    }))),
    element("p", { className: "hint told", id: `${role}-read-out` }));
}

// A record each: their windows are apart, and so are their cursors.
const newReader = (role) => newCursor({
  slider: `${role}-cursor`, words: `${role}-read-out`, values: () => told[role].x, charts: () => [$(`${role}-overlay`)],
  read: (at, nearest) => readOut(told[role], nearest(told[role].x, at)),
});

function readOut({ x, x_unit, unit, measured, simulated, residual }, k) {
  return `${text(x[k], 6)} ${x_unit}: measured ${text(measured[k])} ${unit}, simulated ${text(simulated[k])} ${unit}; residual ${text(residual[k], 3)} ${unit}`;
}

const renew = (role) => fresh($(`${role}-overlay`), showOverlay(role));

function zoomTo(role, from, to) {
  chosen.windows[role] = [from, to];
  return renew(role);
}

export async function showOverlay(role) {
  const where = $(`${role}-overlay`), record = recordOf(role), span = chosen.windows[role];
  const found = await newest(`overlay ${role}`, look("signals", {
    record, channel: chosen.channel, pixels: widthOf(where), ...(chosen.input ? { input: chosen.input } : {}),
    ...(span ? { from: span[0], to: span[1] } : {}),
  }));
  if (!found) return;
  const { x, noise } = found, last = x[x.length - 1], isTime = found.x_unit === "s";
  $(`${role}-record`).value = record;
  $(`${role}-from`).value = text(x[0], 6);
  $(`${role}-to`).value = text(last, 6);
  const by = found.input ? ` by ${found.input}` : "";
  $(`${role}-title`).textContent = `${role}: ${found.record}, ${found.channel}${by}, fit ${text(found.fit_percent)} % of ${text(found.noise_ceiling_percent)} %`;
  const band = isTime
    ? [{ x: [x[0], last], y: [2 * noise[0], 2 * noise[0]], name: "noise, ±2 sigma", line: NOISE, hoverinfo: "skip" },
       { x: [x[0], last], y: [-2 * noise[0], -2 * noise[0]], showlegend: false, fill: "tonexty", fillcolor: SHADE, line: NOISE, hoverinfo: "skip" }]
    : [{ x, y: noise, name: "noise, sigma", line: NOISE }];
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
  if (!where.listens) listen(where, role);
  told[role] = found;
  cursors[role] ??= newReader(role);
  cursors[role].follow(where);
  cursors[role].offer();
}

function listen(where, role) {
  where.listens = true;
  let settle = 0;
  where.on("plotly_relayout", (change) => {
    const from = change["xaxis.range[0]"], to = change["xaxis.range[1]"];
    if (from === undefined || where.layout.xaxis.type === "log") return;
    clearTimeout(settle);
    settle = setTimeout(() => zoomTo(role, from, to).catch(tell), SETTLE_MS);
  });
}
