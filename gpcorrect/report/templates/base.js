// What every chart needs: data, elements, numbers, the tip, and which trajectory is chosen.
const DATA = JSON.parse(document.getElementById("data").textContent);
const column = (i) => (i === undefined ? null : DATA.columns[i]);
const SVG = new DOMParser().parseFromString("<svg></svg>", "text/html").querySelector("svg").namespaceURI;
const colour = (role) => `var(--${role})`;

function add(parent, name, attributes = {}, text) {
  const svg = parent.namespaceURI.endsWith("svg") || name === "svg";
  const made = svg ? document.createElementNS(SVG, name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  parent.append(made);
  return made;
}

const finite = (v) => v !== null && v !== undefined && Number.isFinite(v);
const shown = (v) => (finite(v) ? String(+v.toPrecision(4)).replace("-", "−") : "–");

function extent(lists) {
  let low = Infinity, high = -Infinity;
  for (const list of lists) for (const v of list) if (finite(v)) { if (v < low) low = v; if (v > high) high = v; }
  return low <= high ? [low, high] : [0, 1];
}

// Round numbers that divide a range into about `count` parts.
function ticks(low, high, count) {
  const raw = (high - low) / Math.max(count, 1) || 1, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].find((k) => k * power >= raw * 0.999) * power;
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push([k * step, (k * step).toFixed(Math.min(digits, 12)).replace("-", "−")]);
  return found;
}

// The same for powers of ten, `low` and `high` being logarithms; with their doubles and fives where they are few.
function logTicks(low, high) {
  const found = [], most = high - low > 2.5 ? [1] : [1, 2, 5];
  for (let k = Math.floor(low); k <= high; k++)
    for (const m of most) { const v = Math.log10(m) + k; if (v >= low - 1e-9 && v <= high + 1e-9) found.push([v, shown(m * 10 ** k)]); }
  return found;
}

// Index of the value nearest to `v`, nulls among increasing values skipped.
function nearest(values, v) {
  let best = -1, least = Infinity;
  for (let i = 0; i < values.length; i++) {
    const far = finite(values[i]) ? Math.abs(values[i] - v) : Infinity;
    if (far < least) { least = far; best = i; }
  }
  return best;
}

const tip = add(document.body, "div", { id: "tip", hidden: "" });
function showTip(event, head, rows) {
  tip.replaceChildren();
  add(tip, "b", {}, head);
  for (const [role, text] of rows) {
    const row = add(tip, "div");
    if (role) add(row, "i", { style: `background:${colour(role)}` });
    row.append(text);
  }
  tip.hidden = false;
  const wide = document.documentElement.clientWidth, left = event.pageX + 16;
  tip.style.left = `${Math.max(4, Math.min(left, wide - tip.offsetWidth - 6))}px`;
  const up = left + tip.offsetWidth > wide ? tip.offsetHeight + 14 : -10;
  tip.style.top = `${Math.max(0, event.pageY - up)}px`;
}
const hideTip = () => { tip.hidden = true; };

// Legend whose entries show and hide series, and the buttons beside it.
function tools(figure, state, draw, buttons) {
  const bar = figure.querySelector(".tools") || add(figure, "div", { class: "tools" });
  bar.replaceChildren();
  if (state.choice) add(bar, "span", { class: "which" }, `${DATA.chooses} ${state.choice}`);
  const names = new Map();
  for (const panel of state.panels) for (const s of panel.series) if (s.name && !names.has(s.name)) names.set(s.name, s);
  if (names.size > 1 || state.panels.some((p) => p.legend))
    for (const [name, { role, mark }] of names) {
      const button = add(bar, "button", { type: "button", "aria-pressed": String(!state.hidden.has(name)) });
      add(button, "span", { class: `swatch ${mark}`, style: `background:${colour(role)}` });
      button.append(name);
      button.onclick = () => { if (!state.hidden.delete(name)) state.hidden.add(name); draw(); };
    }
  for (const [text, label, act] of buttons) {
    const button = add(bar, "button", { type: "button", class: "do", "aria-label": label }, text);
    button.onclick = () => { act(); draw(); };
  }
}

// The picture of a figure, empty, of this size in its own pixels.
function canvas(figure, chart, width, height) {
  const svg = figure.querySelector("svg") || add(figure, "svg", { role: "img", "aria-label": chart.caption });
  figure.insertBefore(svg, figure.querySelector("figcaption"));
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  svg.replaceChildren();
  return svg;
}

// Where the pointer is in the picture's own pixels.
function pointer(event, svg) {
  const rect = svg.getBoundingClientRect(), k = svg.viewBox.baseVal.width / rect.width;
  return [(event.clientX - rect.left) * k, (event.clientY - rect.top) * k];
}

// Draw once the figure has a width, and whenever it gets another; a page in the background has none.
function drawn(figure, state, draw) {
  const guarded = () => { if (figure.clientWidth > 0) draw(); };
  new ResizeObserver(() => { if (Math.abs(figure.clientWidth - (state.width || 0)) > 2) guarded(); }).observe(figure);
  return guarded;
}

// Charts that show the chosen trajectory register here.
const followers = [];
function choose(key) {
  for (const follow of followers) follow(key);
  for (const row of document.querySelectorAll("tr[data-key]")) row.setAttribute("aria-selected", String(row.dataset.key === key));
}

function stateOf(chart) {
  const panels = chart.choices ? Object.values(chart.choices)[0] : chart.panels;
  const hidden = new Set();
  for (const panel of panels) for (const s of panel.series) if (s.hidden) hidden.add(s.name);
  return { panels, hidden, view: {}, choice: null };
}
