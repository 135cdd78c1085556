// Paths in three dimensions, seen from any side: drag to turn, point to read.
const SIDE = { turn: -0.6, tilt: 0.45, zoom: 1 };

function space(figure, chart) {
  const state = stateOf(chart);
  state.side = { ...SIDE };
  const draw = drawn(figure, state, () => drawSpace(figure, chart, state, draw));
  if (chart.choices) followers.push((key) => { if (chart.choices[key]) { Object.assign(state, { panels: chart.choices[key], choice: key }); draw(); } });
}

// From a point to the page, the middle of `bounds` in the middle of the picture.
function camera(bounds, equal, side, width, height) {
  const middle = bounds.map(([low, high]) => (low + high) / 2), spans = bounds.map(([low, high]) => high - low || 1);
  const most = Math.max(...spans), unit = spans.map((s) => (equal ? most : s));
  const half = 0.5 * Math.hypot(...spans.map((s, i) => s / unit[i]));
  const k = (side.zoom * (Math.min(width * 0.94, height * 1.1) - 60)) / 2 / half;
  const [ct, st, ce, se] = [Math.cos(side.turn), Math.sin(side.turn), Math.cos(side.tilt), Math.sin(side.tilt)];
  return (point) => {
    const [x, y, z] = point.map((v, i) => (v - middle[i]) / unit[i]);
    const across = ct * x + st * y, away = -st * x + ct * y;
    return [width / 2 + k * across, height / 2 - k * (ce * z + se * away)];
  };
}

function drawSpace(figure, chart, state, draw) {
  const width = (state.width = figure.clientWidth), height = Math.min(460, Math.max(320, width * 0.62)), [panel] = state.panels;
  tools(figure, state, draw, [
    ["+", "Closer", () => { state.side.zoom *= 1.3; }], ["−", "Farther", () => { state.side.zoom /= 1.3; }],
    ["x–y", "From above", () => Object.assign(state.side, { turn: 0, tilt: Math.PI / 2 })],
    ["x–z", "From the front", () => Object.assign(state.side, { turn: 0, tilt: 0 })],
    ["y–z", "From the side", () => Object.assign(state.side, { turn: Math.PI / 2, tilt: 0 })],
    ["3-D", "From a corner", () => Object.assign(state.side, SIDE)],
  ]);
  const svg = canvas(figure, chart, width, height), series = panel.series.filter((s) => !state.hidden.has(s.name));
  const bounds = ["x", "y", "z"].map((n) => extent(panel.series.map((s) => column(s[n]))));
  const see = camera(bounds, panel.equal, state.side, width, height);
  corners(svg, bounds, see, [panel.x_label, panel.y_label, panel.z_label]);
  state.drawn = series.map((s) => {
    const [x, y, z] = ["x", "y", "z"].map((n) => column(s[n]));
    const points = x.map((v, i) => (finite(v) && finite(y[i]) && finite(z[i]) ? see([v, y[i], z[i]]) : null));
    const path = s.mark === "dots" ? { d: points.map((p) => (p ? `M${p[0]} ${p[1]}h0` : "")).join(""), style: "stroke-width:5;stroke-linecap:round" } : { d: stroke(points) };
    add(svg, "path", { class: "mark", stroke: colour(s.role), ...path, ...(s.mark === "dash" ? { "stroke-dasharray": "5 4" } : {}) });
    const first = points.find(Boolean);
    if (first && s.mark !== "dots") add(svg, "circle", { cx: first[0], cy: first[1], r: 3.5, fill: colour(s.role) });
    return { s, points };
  });
  turnable(svg, state, draw);
}

// The box around the paths, with the ends of its axes in numbers.
function corners(svg, bounds, see, labels) {
  const corner = (bits) => bounds.map((b, i) => b[(bits >> i) & 1]);
  for (let bits = 0; bits < 8; bits++)
    for (let axis = 0; axis < 3; axis++)
      if (!((bits >> axis) & 1)) {
        const [a, b] = [see(corner(bits)), see(corner(bits | (1 << axis)))];
        add(svg, "line", { class: "grid", x1: a[0], y1: a[1], x2: b[0], y2: b[1] });
      }
  const middle = [0, 7].reduce((sum, bits) => sum + see(corner(bits))[0] / 2, 0);
  for (let axis = 0; axis < 3; axis++) {
    const edges = [0, 1, 2, 3].map((k) => (axis === 0 ? k << 1 : axis === 1 ? (k & 1) | ((k & 2) << 1) : k)).map((bits) => [see(corner(bits)), see(corner(bits | (1 << axis)))]);
    const score = ([a, b]) => (axis === 2 ? -(a[0] + b[0]) : a[1] + b[1]);
    const [a, b] = edges.sort((m, n) => score(n) - score(m))[0];
    if (Math.hypot(a[0] - b[0], a[1] - b[1]) < 12) continue; // seen along this axis
    const lean = (a[0] + b[0]) / 2 - middle; // away from the box, so that two axes never write over each other
    const anchor = Math.abs(lean) < 20 ? "middle" : lean > 0 ? "start" : "end";
    const write = ([x, y], text) => {
      const low = Math.min(y + (axis === 2 ? 4 : 15), svg.viewBox.baseVal.height - 3);
      const wide = 6.2 * text.length, inside = anchor === "start" ? Math.min(x, svg.viewBox.baseVal.width - wide) : anchor === "end" ? Math.max(x, wide) : x;
      if (axis !== 2) add(svg, "text", { x: inside, y: low, "text-anchor": anchor }, text);
      else if (x > 6.5 * text.length + 10) add(svg, "text", { x: x - 8, y: low, "text-anchor": "end" }, text);
      else add(svg, "text", { x: 2, y: low }, text);
    };
    const along = (k) => [a[0] + k * (b[0] - a[0]), a[1] + k * (b[1] - a[1])]; // corners belong to several edges
    const [low, high] = bounds[axis].map((v) => shown(+v.toPrecision(3)));
    if (0.38 * Math.abs(a[0] - b[0]) < 42 && 0.38 * Math.abs(a[1] - b[1]) < 12) { write(along(0.5), `${labels[axis]} ${low} to ${high}`); continue; }
    write(along(0.12), low);
    write(along(0.88), high);
    write(along(0.5), labels[axis]);
  }
}

function turnable(svg, state, draw) {
  const mark = add(svg, "g");
  svg.style.cursor = "grab";
  svg.onpointerdown = (event) => { state.last = [event.clientX, event.clientY]; svg.setPointerCapture(event.pointerId); };
  svg.onpointerup = svg.onpointercancel = () => { state.last = null; };
  svg.onpointerleave = () => { hideTip(); mark.replaceChildren(); };
  svg.onpointermove = (event) => {
    hideTip();
    if (!state.last) { point(event, svg, mark, state); return; }
    state.side.turn -= (event.clientX - state.last[0]) * 0.01;
    state.side.tilt = Math.min(Math.PI / 2, Math.max(-Math.PI / 2, state.side.tilt + (event.clientY - state.last[1]) * 0.01));
    state.last = [event.clientX, event.clientY];
    draw();
  };
}

// Show where each path was at the moment that is nearest to the pointer.
function point(event, svg, mark, { drawn, panels }) {
  const p = pointer(event, svg);
  let best = -1, least = 20;
  for (const { points } of drawn) points.forEach((q, i) => { if (q) { const far = Math.hypot(q[0] - p[0], q[1] - p[1]); if (far < least) { least = far; best = i; } } });
  mark.replaceChildren();
  if (best < 0) return;
  const rows = drawn.filter(({ points }) => points[best]).map(({ s, points }) => {
    add(mark, "circle", { cx: points[best][0], cy: points[best][1], r: 4, fill: colour(s.role) });
    return [s.role, `${s.name} ${["x", "y", "z"].map((n) => shown(column(s[n])[best])).join(", ")}`];
  });
  const time = column(drawn[0].s.value);
  showTip(event, time ? `time ${shown(time[best])} s` : panels[0].x_label, rows);
}
