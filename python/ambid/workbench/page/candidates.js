// The candidates, and what each would leave: told by pointing at one, with the mouse or the keyboard.

import { allowSteps, look, newest, page } from "./calls.js";
import { chosen, recordOf } from "./choice.js";
import { draw, LOG, SIMULATED } from "./charts.js";
import { $, element, fresh, misfitText, text } from "./dom.js";

const POINT_MS = 80;
const NOW = { color: "#1f4e8c", width: 1.4 }, THEN = { ...SIMULATED, dash: "dash" };
const pointed = { effect: null };

export async function showCandidates(step) {
  const found = await newest("candidates", look("candidates"));
  if (!found) return;
  forgetCandidates();
  const rows = found.candidates;
  $("ranking-hint").textContent = rows.length
    ? `The bar stands between noise and the present misfit, ${misfitText(page.view.misfit)}, on a logarithmic scale. Point at an effect to see what would be left with it; adding fits all parameters.`
    : page.view.fitted ? "Rank the candidates to see what each would bring." : "Fit first: candidates are judged where a fit has ended.";
  $("candidates").hidden = $("foreseen").hidden = !rows.length;
  $("candidates").tBodies[0].replaceChildren(...rows.map((own) => row(own, step)));
  const not = Object.entries(found.not_tried);
  $("not-tried").hidden = !not.length;
  $("not-tried").lastElementChild.replaceChildren(...not.map(([name, why]) => element("li", {}, `${name}: ${why}`)));
  allowSteps();
  pointed.effect = rows[0]?.effect ?? null;
  await fresh($("foreseen"), showForeseen());
}

function row(own, step) {
  return element("tr", { className: own.significant ? "" : "may-be-chance", "data-effect": own.effect,
    onpointerenter: () => pointAt(own.effect), onfocusin: () => pointAt(own.effect) },
    element("td", {}, element("details", {}, element("summary", {}, own.effect), element("p", {}, own.physics), element("p", {}, own.signature),
      element("p", {}, "predicted: " + Object.entries(own.predicted_value).map(([name, value]) => `${name} ${text(value, 3)}`).join(", ")),
      ...(own.confusable_with.length ? [element("p", {}, `acts much like ${own.confusable_with.join(", ")}`)] : []))),
    element("td", { className: "number" }, bar(own.left), ` ${misfitText(own.predicted_misfit)}`),
    element("td", { className: "number" }, own.significant ? own.chance : `${own.chance}, may be chance`),
    element("td", {}, element("button", { type: "button", "data-step": "yes", "aria-label": `add ${own.effect}`, onclick: () => step("add", { name: own.effect }) }, "Add")));
}

function bar(share) {
  const filled = element("span");
  filled.style.width = `${100 * share}%`;
  return element("span", { className: "bar", "aria-hidden": "true" }, filled);
}

let pointing = 0;

// Those of the step before are none of this step's.
export function forgetCandidates() {
  clearTimeout(pointing);
  pointed.effect = null;
}

function pointAt(effect) {
  clearTimeout(pointing);
  if (effect === pointed.effect) return;
  pointing = setTimeout(() => {
    if (page.view.job?.running || $("candidates-section").classList.contains("stale")) return;  // soon these are others
    pointed.effect = effect;
    fresh($("foreseen"), showForeseen());
  }, POINT_MS);
}

export async function showForeseen() {
  for (const own of document.querySelectorAll("tr[data-effect]")) own.classList.toggle("pointed", own.dataset.effect === pointed.effect);
  if (!pointed.effect || !chosen.channel) return;
  const found = await newest("foreseen", look("predicted", { record: recordOf("training"), channel: chosen.channel, effect: pointed.effect }));
  if (!found) return;
  $("foreseen-title").textContent = `What ${found.effect} would leave of ${found.channel}`;
  $("foreseen-told").textContent = found.lines.join("\n");
  const marked = (y, name, line, symbol) => ({ x: found.frequency_hz, y, name, mode: "lines+markers", line, marker: { symbol, size: 6, color: line.color } });
  await draw($("foreseen-chart"), [marked(found.now, "now", NOW, "circle-open"), marked(found.then, `with ${found.effect}, predicted`, THEN, "x-thin-open")], {
    hovermode: "x unified", margin: { l: 52, r: 8, t: 8, b: 36 },
    xaxis: { title: { text: "frequency [Hz]" }, type: "log", autorange: true }, yaxis: { ...LOG, title: { text: "misfit" }, dtick: 1 },
    shapes: [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: 1, y1: 1, line: { dash: "dot", color: "#555", width: 1 } }],
  });
}
