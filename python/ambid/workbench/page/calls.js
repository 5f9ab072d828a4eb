// What the page asks of the server, and the step that it shows.

import { element, tell } from "./dom.js";

export const page = { base: "", view: null, renew: () => {} };

const GONE_ON = 204;

async function answer(response) {
  if (response.status === GONE_ON) return null;
  const found = await response.json().catch(() => ({ error: `the server answers ${response.status}` }));
  if (!response.ok) throw new Error(found.error ?? `the server answers ${response.status}`);
  return found;
}

export async function ask(call, given = {}) {
  return answer(await fetch(`${page.base}/${call}?${new URLSearchParams(given)}`));
}

// Something of the step that is shown, or null where the server has gone on: then the newer step is shown soon.
export async function look(call, given = {}) {
  const found = await ask(call, { revision: page.view.revision, ...given });
  if (found === null) page.renew();
  return found;
}

export async function post(path, given = {}) {
  return answer(await fetch(path, {
    method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(given),
  }));
}

const latest = {};

// The answer, or null where a newer question of this kind was asked meanwhile.
export async function newest(kind, asked) {
  const mine = (latest[kind] = (latest[kind] ?? 0) + 1);
  const found = await asked;
  return latest[kind] === mine ? found : null;
}

// No step begins while a job runs.
export function allowSteps() {
  const running = Boolean(page.view.job?.running);
  for (const own of document.querySelectorAll("[data-step]")) own.disabled = running || own.dataset.step === "no";
}

export async function download(name) {
  const response = await fetch(`${page.base}/${name}`);
  if (!response.ok) return tell(new Error((await response.json()).error));
  const link = element("a", { href: URL.createObjectURL(await response.blob()), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
