// A cursor through charts: it follows the pointer, or a slider from the keyboard, and tells the values in words.

import { $, element } from "./dom.js";

// By the place of a slider and of a paragraph; `charts`, `values` and `read` are asked anew each time.
export function newCursor({ slider, words, charts, values, read, scale = (value) => value }) {
  let at = null;

  const nearest = (all, value) => all.reduce(
    (best, own, k) => (Math.abs(scale(own) - scale(value)) < Math.abs(scale(all[best]) - scale(value)) ? k : best), 0);

  function mark(where) {
    const line = where.querySelector(".cursor"), axis = where._fullLayout?.xaxis;
    if (!line || !axis || at === null) return;
    const left = axis.d2p(at), { t, b } = where._fullLayout._size;
    line.hidden = !(left >= 0 && left <= axis._length);
    Object.assign(line.style, { left: `${axis._offset + left}px`, top: `${t}px`, bottom: `${b}px` });
  }

  function light(value) {
    at = value;
    const told = read(at, nearest);
    $(slider).value = nearest(values(), at);
    $(slider).setAttribute("aria-valuetext", told);
    $(words).textContent = told;
    charts().forEach(mark);
  }

  function follow(where) {
    mark(where);
    if (where.follows) return;
    where.follows = true;
    where.append(element("div", { className: "cursor", hidden: true }));
    where.on("plotly_hover", (event) => light(event.points[0].x));
    where.on("plotly_relayout", () => mark(where));
  }

  function offer() {
    $(slider).max = Math.max(0, values().length - 1);
    $(slider).disabled = !values().length;
    if (at !== null) light(at);
  }

  return { follow, offer, step: (event) => light(values()[+event.target.value]) };
}
