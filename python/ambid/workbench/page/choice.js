// Which channel, excitation, band and records the charts show: chosen in one place, followed by all.

import { page } from "./calls.js";
import { $, bandText, element } from "./dom.js";

export const chosen = { channel: null, input: null, band: null, records: { training: 0, validation: null }, windows: {} };
const MOST = "missed most";
const TOUCH = 1.001;  // bands that only share an edge do not overlap
const followers = [];

export const onChoice = (follow) => followers.push(follow);

export const roles = () => ["training", "validation"].filter((role) => page.view.records.some((own) => own.role === role));

export function recordOf(role) {
  const own = chosen.records[role];
  return own !== null && page.view.records[own]?.role === role ? own : page.view.records.findIndex((one) => one.role === role);
}

export function choose(wanted, record) {
  if (wanted.channel && wanted.channel !== chosen.channel) chosen.windows = {};
  Object.assign(chosen, wanted);
  if (record !== undefined) chosen.records[page.view.records[record].role] = record;
  showChoice();
  for (const follow of followers) follow();
}

export function showChoice() {
  const names = page.view.records[0].channels.map((own) => own.channel);
  fill($("channel"), names.map((name) => [name, name]), chosen.channel);
  $("band").textContent = chosen.band ? bandText(chosen.band) : "all";
  $("clear-band").disabled = !chosen.band;
  for (const cell of document.querySelectorAll(".cells button")) cell.setAttribute("aria-pressed", String(isChosen(cell.dataset)));
}

// The excitations that the records have responses to.
export function offerInputs(inputs) {
  const known = [...$("input").options].map((own) => own.value).filter(Boolean);
  const all = [...new Set([...known, ...inputs, ...(chosen.input ? [chosen.input] : [])])];
  fill($("input"), [["", MOST], ...all.map((name) => [name, name])], chosen.input ?? "");
}

function fill(select, options, value) {
  if (options.map(([own]) => own).join() !== [...select.options].map((own) => own.value).join()) {
    select.replaceChildren(...options.map(([own, label]) => element("option", { value: own }, label)));
  }
  select.value = value;
}

function isChosen({ channel, input, low, high }) {
  return chosen.band !== null && channel === chosen.channel && (input === undefined || input === chosen.input)
    && low * TOUCH < chosen.band[1] && high > chosen.band[0] * TOUCH;
}

$("channel").onchange = (event) => choose({ channel: event.target.value });
$("input").onchange = (event) => choose({ input: event.target.value || null });
$("clear-band").onclick = () => choose({ band: null });
