const $ = id => document.getElementById(id);
const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const element = (tag, text, className) => { const e = document.createElement(tag); e.textContent = text; if (className) e.className = className; return e; };
const fixed = (x, digits) => x === null || x === undefined ? "–" : x.toFixed(digits);
// A cell is its text, or [text, class]. `table`: the element or its id. Returns the row.
const row = (table, cells, head, className) => {
  const tr = document.createElement("tr");
  if (className) tr.className = className;
  cells.forEach(c => tr.append(Array.isArray(c) ? element("td", c[0], c[1]) : element(head ? "th" : "td", c)));
  (typeof table === "string" ? $(table) : table).append(tr);
  return tr;
};
// A card with one figure, into the element `figures`.
const figure = (name, value, unit, note) => {
  const card = element("div", "", "card figure"), v = element("div", value, "value");
  v.append(element("small", unit));
  card.append(element("div", name, "name"), v, element("div", note, "note"));
  $("figures").append(card);
};
// The colour of one of many things beside each other.
const hue = (i, count) => `hsl(${Math.round(212 + i * 360 / count) % 360} 62% ${matchMedia("(prefers-color-scheme: dark)").matches ? 66 : 44}%)`;
