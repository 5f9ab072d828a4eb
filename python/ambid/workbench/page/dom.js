// Elements of the page, and numbers as they are written there.

export const $ = (id) => document.getElementById(id);

export const text = (value, digits = 4) => (value === null || value === undefined ? "–" : String(Number(value.toPrecision(digits))));

export const misfitText = (value) => (value === null ? "–" : value < 10 ? value.toFixed(3) : value.toPrecision(4));

export const bandText = ([low, high]) => `${text(low, 3)} .. ${text(high, 3)} Hz`;

export function element(tag, options = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(options)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name in made && name !== "list") made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

export function tell(error) {
  const lost = error instanceof TypeError ? "the server does not answer; is the command still running?" : error.message;
  $("error").textContent = lost;
  $("error").hidden = !lost;
}

const turns = new Map();

// Greys what is being renewed, until the newest renewal is there.
export async function fresh(where, renewed) {
  const turn = (turns.get(where) ?? 0) + 1;
  turns.set(where, turn);
  where.classList.add("stale");
  where.setAttribute("aria-busy", "true");
  try {
    await renewed;
  } catch (error) {
    return turns.get(where) === turn ? tell(error) : undefined;
  }
  if (turns.get(where) !== turn) return;
  where.classList.remove("stale");
  where.removeAttribute("aria-busy");
}
