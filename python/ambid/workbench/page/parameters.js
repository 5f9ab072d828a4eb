// Parameters by hand: a slider tells the misfit that its value would have, letting go takes it as a step.

import { allowSteps, look, page } from "./calls.js";
import { $, element, misfitText, text } from "./dom.js";

const LET_GO_MS = 400;

function moved(own) {
  if (own.was === null || own.was === own.value) return "–";
  const by = own.moved_by_std_errors === null ? "" : `${text(own.moved_by_std_errors, 3)} std errors `;
  return `${by}from ${text(own.was, 6)}`;
}

let letGo = 0;

export function showParameters(step) {
  const held = document.activeElement?.closest("#parameters") ? document.activeElement.getAttribute("aria-label") : null;
  $("preview").textContent = "";
  $("parameters").tBodies[0].replaceChildren(...page.view.parameters.map((own) => {
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
  allowSteps();
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
    const told = `${now.name} = ${text(Number(now.value), 5)} ${own.unit}`;
    try {
      const found = await look("preview", now);
      if (!found) continue;
      const kept = found.validation_misfit === null ? "" : `, validation ${misfitText(found.validation_misfit)}`;
      $("preview").textContent = `${told}: training ${misfitText(found.misfit)}${kept}`;
      slider.setAttribute("aria-valuetext", `${told.split(" = ")[1]}, misfit ${misfitText(found.misfit)}`);
    } catch (error) {
      $("preview").textContent = `${told}: ${error.message}`;
    }
  }
  asking = false;
}
