// Tables of cells to click: the map of channels and bands, and the matrix of excitations and outputs.

import { look, newest, page } from "./calls.js";
import { choose, chosen, showChoice } from "./choice.js";
import { $, bandText, element, fresh, text } from "./dom.js";

const NONE = "none";  // what follows no excitation

export async function showMaps() {
  const found = await newest("where", look("where"));
  if (!found) return;
  $("sentence").textContent = found.sentence;
  chosen.channel ??= found.worst?.channel ?? page.view.records[0].channels[0].channel;
  $("maps").replaceChildren(...found.maps.map(mapTable));
  showChoice();
}

export async function showMatrices() {
  const found = await newest("matrix", look("matrix"));
  if (!found) return;
  $("matrices").replaceChildren(...found.matrices.map(matrixTable));
  const train = found.matrices.find((own) => page.view.records[own.index].role === "training");
  $("answers").replaceChildren(...(train?.lines ?? []).map((line) => element("li", {}, line)));
  showChoice();
}

function button(row, column, level, label, shown, where, record) {
  return element("td", {}, element("button", {
    type: "button", className: `level-${level}`, tabIndex: row || column ? -1 : 0, "data-row": row, "data-column": column,
    "data-channel": where.channel, "data-low": where.band[0], "data-high": where.band[1],
    ...(where.input ? { "data-input": where.input } : {}),
    "aria-label": label, title: label, onclick: () => choose(where.input === NONE ? { channel: where.channel, band: where.band } : where, record), onkeydown: walk,
  }, shown));
}

function mapTable(own, record) {
  const bands = own.cells[0].map((_, b) => [own.edges_hz[b], own.edges_hz[b + 1]]);
  const head = element("tr", {}, element("th", { scope: "col" }, "Hz"), ...bands.map((band) => element("th", { scope: "col" }, text(band[0], 2))));
  const rows = own.channels.map((channel, r) => element("tr", {}, element("th", { scope: "row" }, channel), ...bands.map((band, c) => {
    const cell = own.cells[r][c];
    const label = `${channel}, ${text(band[0], 3)} to ${text(band[1], 3)} Hz, misfit ${cell.text || "not measured"}`;
    return button(r, c, cell.level, label, cell.text, { channel, band }, record);
  })));
  return table("map", record, own.record, [head], rows);
}

function matrixTable(own) {
  const inputs = [...own.inputs, NONE];
  const over = element("tr", {}, element("th", { scope: "col" }, "Hz"), ...own.bands.map((band) => element("th", { scope: "colgroup", colSpan: inputs.length }, `${text(band.low, 2)} .. ${text(band.high, 2)}`)));
  const head = element("tr", {}, element("th", { scope: "col" }, "by"), ...own.bands.flatMap(() => inputs.map((name) => element("th", { scope: "col", className: name === NONE ? "last" : "" }, element("span", { className: "upright" }, name)))));
  const rows = own.outputs.map((channel, r) => element("tr", {}, element("th", { scope: "row" }, channel), ...own.bands.flatMap(({ low, high, rows: cells, rest }, b) => inputs.map((input, c) => {
    const cell = input === NONE ? rest[r] : cells[r][c];
    const label = `${channel} by ${input}, ${bandText([low, high])}, ${cell.words}`;
    const made = button(r, b * inputs.length + c, cell.level, label, cell.text, { channel, input, band: [low, high] }, own.index);
    if (input === NONE) made.className = "last";
    return made;
  }))));
  return element("div", { className: "across" }, table("matrix", own.index, own.record, [over, head], rows));
}

function table(kind, record, name, head, rows) {
  return element("table", { className: `cells ${kind}`, "data-record": record },
    element("caption", {}, `${page.view.records[record].role}: ${name}`), element("thead", {}, ...head), element("tbody", {}, ...rows));
}

function walk(event) {
  const by = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] }[event.key];
  if (!by) return;
  event.preventDefault();
  const at = event.target, cells = at.closest("table");
  const next = cells.querySelector(`[data-row="${+at.dataset.row + by[0]}"][data-column="${+at.dataset.column + by[1]}"]`);
  if (!next) return;
  at.tabIndex = -1;
  next.tabIndex = 0;
  next.focus();
}

export const showCells = () => {
  fresh($("matrix"), showMatrices());
  return fresh($("where"), showMaps());
};
