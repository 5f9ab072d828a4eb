// The page: what is clicked is sent, what comes back is shown. All numbers are the server's.

import { allowSteps, ask, download, page, post } from "./calls.js";
import { forgetCandidates, showCandidates, showForeseen } from "./candidates.js";
import { showCells } from "./cells.js";
import { draw, overlayPanel, showOverlay } from "./charts.js";
import { chosen, onChoice, roles } from "./choice.js";
import { $, element, fresh, misfitText, tell, text } from "./dom.js";
import { responsePanel, showResponses, showSpectrum, spectrumPanel } from "./frequency.js";
import { showParameters } from "./parameters.js";

const POLL_MS = 200;
let shown = null, heard = null, last = Promise.resolve();

// One step after the other: each is taken on the step that the page shows.
function step(call, given = {}) {
  last = last.then(() => taken(call, given));
  return last;
}

async function taken(call, given) {
  tell({ message: "" });
  try {
    await show(await post(`${page.base}/${call}`, { revision: page.view.revision, ...given }));
  } catch (error) {
    tell(error);
    await show(await ask("view"));
  }
}

async function show(next) {
  page.view = next;
  showJob();
  if (next.revision !== shown) showStep();
  if (next.job?.running) setTimeout(async () => { try { await show(await ask("view")); } catch (error) { tell(error); } }, POLL_MS);
  else await concluded();
}

// The server has gone on without this page: another window of the session, or a job that has just ended.
let renewing = false;

page.renew = async () => {
  if (renewing || page.view.job?.running) return;  // a job's end is looked for anyway
  renewing = true;
  try { await show(await ask("view")); } catch (error) { tell(error); }
  renewing = false;
};

// All of a new step; nothing waits for a chart, which of a long record may take its time.
function showStep() {
  shown = page.view.revision;
  forgetCandidates();
  showHead();
  showSteps();
  showParameters(step);
  const isFirst = chosen.channel === null;  // then the worst cell says which channel the charts show
  const cells = showCells();
  if (isFirst) cells.then(() => chosen.channel && showCharts());
  else showCharts();
  fresh($("candidates-section"), cells.then(() => showCandidates(step)));
}

async function concluded() {
  const job = page.view.job;
  if (job === null || heard === job.number) return;
  heard = job.number;
  if (job.error) tell({ message: job.error });
  else if (job.what === "report") await download("report.html");
}

function showJob() {
  const job = page.view.job, running = Boolean(job?.running);
  $("job").hidden = !running;
  if (running) {
    $("doing").textContent = job.total ? `${job.doing}, ${job.done + 1} of ${job.total}` : `${job.doing} ${job.done || ""}`;
    if (job.total) { $("progress").max = job.total; $("progress").value = job.done; } else $("progress").removeAttribute("value");
  }
  document.body.setAttribute("aria-busy", String(running));
  allowSteps();
}

function showHead() {
  const view = page.view;
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
  showFindings(view.findings);
}

function showFindings(found) {
  const counts = ["error", "warning", "note"].map((severity) => [severity, found.filter((own) => own.severity === severity).length]);
  $("found").textContent = counts.filter(([, count]) => count).map(([severity, count]) => `${count} ${severity}${count > 1 ? "s" : ""}`).join(", ");
  $("found").hidden = $("findings-section").hidden = !found.length;
  $("findings").replaceChildren(...found.map(({ severity, where, message, remedy }) => {
    const place = [where.record || where.file, where.key, where.channel || where.axis].filter(Boolean).join(", ");
    return element("li", { className: severity }, element("b", {}, severity), ` ${place ? `${place}: ` : ""}${message}`,
      ...(remedy ? [element("span", { className: "remedy" }, `→ ${remedy}`)] : []));
  }));
}

function showSteps() {
  const view = page.view;
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

// Where the charts of a kind stand, what makes the panel of one, and what draws it.
const CHARTS = [
  ["overlays", "overlay", overlayPanel, showOverlay],
  ["responses", "responses", responsePanel, showResponses],
  ["spectra", "lines", spectrumPanel, showSpectrum],
];

function showCharts() {
  for (const [place, name, make, draws] of CHARTS) {
    if ($(place).childElementCount !== roles().length) {
      $(place).replaceChildren(...roles().map(make));
      for (const pick of $(place).querySelectorAll(".window select")) pick.onchange = () => otherRecord(pick);
    }
    for (const role of roles()) fresh($(`${role}-${name}`), draws(role));
  }
}

function otherRecord(pick) {
  const role = pick.id.replace("-record", "");
  chosen.records[role] = +pick.value;
  delete chosen.windows[role];
  showCharts();
}

async function begin() {
  const kept = sessionStorage.getItem("window");  // a reload goes on where it was
  page.base = `windows/${kept}`;
  let first = kept ? await ask("view").catch(() => null) : null;
  if (!first) {
    const { window: name } = await post("windows");
    sessionStorage.setItem("window", name);
    page.base = `windows/${name}`;
    first = await ask("view");
  }
  heard = first.job && !first.job.running ? first.job.number : null;
  await show(first);
}

onChoice(showCharts);
onChoice(() => fresh($("foreseen"), showForeseen()));
$("fit").onclick = () => step("fit");
$("rank").onclick = () => step("rank");
$("undo").onclick = () => step("undo");
$("cancel").onclick = () => post(`${page.base}/cancel`).catch(tell);
$("export-python").onclick = () => download("workbench.py");
$("export-model").onclick = () => download("model.json");
$("export-report").onclick = () => step("report");
$("export-report").dataset.step = "yes";
begin().catch(tell);
