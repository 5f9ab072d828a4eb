// Charts over frequency, training and validation side by side, with one cursor through all of them.

import { look, newest } from "./calls.js";
import { chosen, offerInputs, recordOf, roles } from "./choice.js";
import { draw, LOG, NOISE, SHADE, SIMULATED, widthOf } from "./charts.js";
import { newCursor } from "./cursor.js";
import { $, element, text } from "./dom.js";

const BEFORE = { color: "#1f4e8c", width: 1.4, dash: "dash" }, GUIDE = { dash: "dot", color: "#555" };
const STYLES = [SIMULATED, BEFORE];
const SEEN = { symbol: "circle-open", size: 5, color: "#404040" }, LOST = { symbol: "circle", size: 3, color: "#8c8c8c" }, MARKS = ["circle-open", "x-thin-open"];
const told = {};

const panel = (role, name) => element("div", { className: "panel" }, element("h3", { id: `${role}-${name}-title` }, role),
  element("p", { className: "hint", id: `${role}-${name}-why`, hidden: true }),
  element("div", { className: `chart ${name}`, id: `${role}-${name}`, role: "img", "aria-labelledby": `${role}-${name}-title` }));

export const responsePanel = (role) => panel(role, "responses");
export const spectrumPanel = (role) => panel(role, "lines");

const bandShape = () => (chosen.band ? [{
  type: "rect", yref: "paper", x0: chosen.band[0], x1: chosen.band[1], y0: 0, y1: 1, fillcolor: "rgba(224,135,0,.18)", line: { color: "#e08700", width: 1 },
}] : []);

const frequencyAxis = (more = {}) => ({ title: { text: "frequency [Hz]" }, type: "log", autorange: true, ...more });

export async function showResponses(role) {
  const where = $(`${role}-responses`);
  const found = await newest(`responses ${role}`, look("responses", {
    record: recordOf(role), channel: chosen.channel, pixels: widthOf(where), ...(chosen.input ? { input: chosen.input } : {}),
  }));
  if (!found) return;
  told[role] = found.why_not ? null : found;
  $(`${role}-responses-why`).textContent = found.why_not;
  $(`${role}-responses-why`).hidden = !found.why_not;
  where.hidden = Boolean(found.why_not);
  $(`${role}-responses-title`).textContent = `${role}: ${found.record}, ${found.output} by ${found.input ?? chosen.input ?? "nothing"}`;
  if (found.why_not) return;
  offerInputs(found.inputs);
  const x = found.frequency_hz, edge = { x, mode: "lines", line: { width: 0 }, hoverinfo: "none" };
  const traces = [
    { ...edge, y: found.high, showlegend: false },
    { ...edge, y: found.low, fill: "tonexty", fillcolor: SHADE, name: `noise, ±${found.sigmas} sigma` },
    { x, y: found.size.map((size, k) => (found.phase[k] === null ? null : size)), mode: "markers", marker: SEEN, name: "measured" },
    { x, y: found.size.map((size, k) => (found.phase[k] === null ? size : null)), mode: "markers", marker: LOST, name: "lost in noise" },
    { x, y: found.phase, mode: "markers", marker: SEEN, yaxis: "y2", showlegend: false },
    { x, y: found.noise, mode: "lines", line: { ...NOISE, width: 2 }, yaxis: "y3", name: "noise, sigma" },
    ...found.models.flatMap((own, k) => [
      { x: own.frequency_hz, y: own.size, line: STYLES[k], name: own.size.some((size) => size !== null) ? own.name : `${own.name}: nothing`, mode: "lines" },
      { x: own.frequency_hz, y: own.phase, line: STYLES[k], yaxis: "y2", showlegend: false, mode: "lines" },
      { x, y: own.left, mode: "lines+markers", line: { ...STYLES[k], width: 0.7 }, marker: { symbol: MARKS[k], size: 4, color: STYLES[k].color }, yaxis: "y3", showlegend: false },
    ]),
  ].map((own) => ({ hoverinfo: "none", ...own }));
  await draw(where, traces, {
    hovermode: "x", shapes: bandShape(),
    xaxis: frequencyAxis({ anchor: "y3" }),
    yaxis: { ...LOG, title: { text: `magnitude [${found.unit}]` }, domain: [0.52, 1] },
    yaxis2: { title: { text: "phase [°]" }, domain: [0.29, 0.47], range: [-200, 200], tickvals: [-180, 0, 180], zeroline: false },
    yaxis3: { ...LOG, title: { text: `residual [${found.unit}]` }, domain: [0, 0.24] },
  });
  cursor.follow(where);
  cursor.offer();
}

export async function showSpectrum(role) {
  const where = $(`${role}-lines`);
  const found = await newest(`lines ${role}`, look("lines", { record: recordOf(role), channel: chosen.channel, pixels: widthOf(where) }));
  if (!found) return;
  $(`${role}-lines-title`).textContent = `${role}: ${found.record}, ${chosen.channel}: residual power on each line, in units of its noise`;
  await draw(where, [{ x: found.frequency_hz, y: found.misfit, mode: "lines+markers", name: "misfit", hoverinfo: "none", line: { color: "#1f4e8c", width: 0.6 }, marker: { size: 3, color: "#1f4e8c" } }], {
    showlegend: false, hovermode: "x", xaxis: frequencyAxis(), yaxis: { ...LOG, title: { text: "misfit" }, dtick: 1 },
    shapes: [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: 1, y1: 1, line: GUIDE }, ...bandShape()],
  });
  cursor.follow(where);
}

// ---- the cursor

const frequencies = () => told[roles().find((role) => told[role])]?.frequency_hz ?? [];

// One frequency in all charts, and in words.
const cursor = newCursor({
  slider: "cursor", words: "read-out", values: frequencies, scale: Math.log,
  charts: () => document.querySelectorAll(".chart.responses, .chart.lines"),
  read: (at, nearest) => roles().filter((role) => told[role]).map((role) => readOut(role, nearest(told[role].frequency_hz, at))).join("\n"),
});

function readOut(role, k) {
  const own = told[role], unit = own.unit;
  const models = own.models.map((model) => `${text(model.left[k], 3)} left ${model.name}`).join(", ");
  const phase = own.phase[k] === null ? "phase lost in noise" : `${text(own.phase[k], 3)}°`;
  return `${role}, ${text(own.frequency_hz[k], 4)} Hz: ${text(own.size[k], 3)} ${unit}, ${phase}; ${models}; noise ${text(own.noise[k], 2)} ${unit}`;
}

$("cursor").oninput = cursor.step;
