// Flat charts: lines, bands, dots, bars and cells on shared or separate axes; drag to zoom, point to read.
const MARGIN = { left: 58, right: 12, top: 20, bottom: 34 };

function plot(figure, chart) {
  const state = stateOf(chart);
  const draw = drawn(figure, state, () => drawPlot(figure, chart, state, draw));
  if (chart.choices) followers.push((key) => { if (chart.choices[key]) { Object.assign(state, { panels: chart.choices[key], choice: key, view: {} }); draw(); } });
}

function drawPlot(figure, chart, state, draw) {
  const width = (state.width = figure.clientWidth), columns = width < 560 ? 1 : chart.columns || 1;
  const zoomed = Object.keys(state.view).length > 0;
  tools(figure, state, draw, zoomed ? [["reset zoom", "Show all again", () => { state.view = {}; }]] : []);
  const rows = Math.ceil(state.panels.length / columns), wide = width / columns;
  const heights = state.panels.map((p) => p.height || (p.rows ? 62 + 24 * p.rows.length : p.equal ? Math.min(wide, 420) : 190));
  const tall = Array.from({ length: rows }, (_, r) => Math.max(...heights.slice(r * columns, (r + 1) * columns)));
  const svg = canvas(figure, chart, width, tall.reduce((a, b) => a + b, 0));
  const margins = state.panels.map((p) => marginOf(p, wide)), margin = chart.shared ? Math.max(...margins) : 0;
  let top = 0;
  const drawn = state.panels.map((panel, i) => {
    const row = Math.floor(i / columns), box = { left: (i % columns) * wide, top, width: wide, height: tall[row], margin };
    if (i % columns === columns - 1) top += tall[row];
    return drawPanel(svg, panel, box, state, chart.shared ? "all" : i, i);
  });
  listen(svg, drawn, state, chart, draw);
}

// Room for the names of rows.
const marginOf = (panel, wide) => Math.max(MARGIN.left, panel.rows ? Math.min(wide * 0.45, 24 + 6.4 * Math.max(...panel.rows.map((r) => r.length))) : 0);

// The axes of a panel, from data to pixels and back; `view` is what the reader zoomed to.
function axes(panel, box, series, view) {
  const tx = panel.log_x ? Math.log10 : (v) => v, ty = panel.log_y ? Math.log10 : (v) => v;
  const left = box.left + (box.margin || marginOf(panel, box.width));
  const area = { left, top: box.top + MARGIN.top, right: box.left + box.width - MARGIN.right, bottom: box.top + box.height - MARGIN.bottom };
  const keep = (v, log) => finite(v) && (!log || v > 0);
  const range = (names, given, log, pad) => {
    if (given) return given.map(log ? Math.log10 : (v) => v);
    const lists = series.flatMap((s) => names.map((n) => column(s[n]) || []).map((l) => l.filter((v) => keep(v, log))));
    let [low, high] = extent(lists).map(log ? Math.log10 : (v) => v);
    if (high - low < 1e-12) { low -= 0.5; high += 0.5; }
    const more = pad * (high - low);
    return [low - more, high + more];
  };
  let x = view?.x || range(["x", "x2"], panel.x_range, panel.log_x, series.some((s) => s.mark === "dots") ? 0.03 : 0);
  const inside = view?.x && !view.y && !panel.equal ? series.map((s) => within(s, x, tx)) : null;
  let y = panel.rows ? [panel.rows.length - 0.5, -0.5] : view?.y || (inside ? padded(extent(inside)) : range(["y", "y2"], panel.y_range, panel.log_y, 0.06));
  if (panel.equal) [x, y] = evened(x, y, area);
  const sx = (v) => area.left + ((tx(v) - x[0]) / (x[1] - x[0])) * (area.right - area.left);
  const sy = (v) => area.bottom - ((ty(v) - y[0]) / (y[1] - y[0])) * (area.bottom - area.top);
  const back = { x: (p) => x[0] + ((p - area.left) / (area.right - area.left)) * (x[1] - x[0]), y: (p) => y[0] + ((area.bottom - p) / (area.bottom - area.top)) * (y[1] - y[0]) };
  return { area, x, y, sx, sy, back };
}
const within = (s, x, tx) => ["y", "y2"].flatMap((n) => (column(s[n]) || []).filter((v, i) => finite(v) && tx(column(s.x)[i]) >= x[0] && tx(column(s.x)[i]) <= x[1]));
const padded = ([low, high]) => { const more = 0.06 * (high - low) || 0.5; return [low - more, high + more]; };
function evened(x, y, area) {
  const unit = Math.max((x[1] - x[0]) / (area.right - area.left), (y[1] - y[0]) / (area.bottom - area.top));
  const grown = ([low, high], size) => { const middle = (low + high) / 2, half = (unit * size) / 2; return [middle - half, middle + half]; };
  return [grown(x, area.right - area.left), grown(y, area.bottom - area.top)];
}

function drawPanel(svg, panel, box, state, key, number) {
  const series = panel.series.filter((s) => !state.hidden.has(s.name));
  const scale = axes(panel, box, series, state.view[key]), { area, sx, sy } = scale;
  const id = `clip-${svg.parentNode.dataset.chart}-${number}`;
  const clip = add(svg, "clipPath", { id });
  add(clip, "rect", { x: area.left, y: area.top, width: area.right - area.left, height: area.bottom - area.top });
  grid(svg, panel, scale, box);
  const inner = add(svg, "g", { "clip-path": `url(#${id})` });
  for (const [from, to] of panel.spans || []) add(inner, "rect", { class: "span", x: sx(from), y: area.top, width: Math.max(sx(to) - sx(from), 2), height: area.bottom - area.top });
  for (const s of series) MARKS[s.mark](inner, s, scale, panel);
  return { panel, series, scale, box, key };
}

function grid(svg, panel, { area, x, y }, box) {
  const px = (v) => area.left + ((v - x[0]) / (x[1] - x[0])) * (area.right - area.left);
  const py = (v) => area.bottom - ((v - y[0]) / (y[1] - y[0])) * (area.bottom - area.top);
  const across = panel.log_x ? logTicks(...x) : ticks(...x, (area.right - area.left) / 70);
  for (const [v, text] of panel.x_names ? panel.x_names.map((n, i) => [i, n]) : across) {
    add(svg, "line", { class: "grid", x1: px(v), x2: px(v), y1: area.top, y2: area.bottom });
    add(svg, "text", { x: px(v), y: area.bottom + 14, "text-anchor": "middle" }, text);
  }
  const most = (area.left - box.left - 12) / 6.2;
  const cut = (name) => (name.length > most ? `${name.slice(0, most - 1)}…` : name);
  const up = panel.rows ? panel.rows.map((name, i) => [i, cut(name)]) : panel.log_y ? logTicks(...y) : ticks(...y, (area.bottom - area.top) / 32);
  for (const [v, text] of up) {
    if (!panel.rows) add(svg, "line", { class: "grid", x1: area.left, x2: area.right, y1: py(v), y2: py(v) });
    add(svg, "text", { x: area.left - 6, y: py(v) + 4, "text-anchor": "end" }, text);
  }
  add(svg, "rect", { class: "frame", x: area.left, y: area.top, width: area.right - area.left, height: area.bottom - area.top });
  add(svg, "text", { x: (area.left + area.right) / 2, y: area.bottom + 29, "text-anchor": "middle" }, panel.x_label);
  if (panel.y_label) add(svg, "text", { x: box.left + 12, y: (area.top + area.bottom) / 2, "text-anchor": "middle", transform: `rotate(-90 ${box.left + 12} ${(area.top + area.bottom) / 2})` }, panel.y_label);
  if (panel.title) add(svg, "text", { class: "title", x: area.left, y: area.top - 7 }, panel.title);
}

function stroke(points) {
  let path = "", pen = false;
  for (const p of points) { path += p ? `${pen ? "L" : "M"}${p[0].toFixed(1)} ${p[1].toFixed(1)}` : ""; pen = Boolean(p); }
  return path;
}
const placed = (xs, ys, { sx, sy }) => xs.map((v, i) => { const p = finite(v) && finite(ys[i]) ? [sx(v), sy(ys[i])] : null; return p && finite(p[0]) && finite(p[1]) ? p : null; });

const MARKS = {
  line: (g, s, scale) => add(g, "path", { class: "mark", d: stroke(placed(column(s.x), column(s.y), scale)), stroke: colour(s.role) }),
  dash: (g, s, scale) => add(g, "path", { class: "mark", d: stroke(placed(column(s.x), column(s.y), scale)), stroke: colour(s.role), "stroke-dasharray": "5 4" }),
  dots: (g, s, scale) => add(g, "path", { class: "mark", d: placed(column(s.x), column(s.y), scale).map((p) => (p ? `M${p[0].toFixed(1)} ${p[1].toFixed(1)}h0` : "")).join(""), stroke: colour(s.role), style: `stroke-width:${s.size || 4};stroke-linecap:round`, opacity: s.size && s.size < 3 ? 0.5 : 1 }),
  crosses: (g, s, scale) => add(g, "path", { class: "mark", d: placed(column(s.x), column(s.y), scale).map((p) => (p ? `M${p[0] - 4} ${p[1] - 4}l8 8m-8 0l8 -8` : "")).join(""), stroke: colour(s.role) }),
  band: (g, s, scale) => {
    const low = placed(column(s.x), column(s.y), scale), high = placed(column(s.x), column(s.y2), scale);
    let d = "", first = 0;
    for (let i = 0; i <= low.length; i++)
      if (i === low.length || !low[i] || !high[i]) {
        if (i > first) d += `${stroke(low.slice(first, i))}L${stroke(high.slice(first, i).reverse()).slice(1)}Z`;
        first = i + 1;
      }
    add(g, "path", { d, fill: colour(s.role), opacity: 0.18 });
  },
  bars: (g, s, { sx, sy, area }) => {
    const from = column(s.x), to = column(s.x2), rows = column(s.y);
    rows.forEach((row, i) => {
      const high = Math.abs(sy(1) - sy(0)) * (s.size || 0.62), left = Math.max(sx(from[i]), area.left), right = sx(to[i]);
      add(g, "rect", { x: Math.min(left, right), y: sy(row) - high / 2, width: Math.max(Math.abs(right - left), 1), height: high, fill: colour(s.role) });
      const beside = s.labels ? Math.min(Math.max(left, right) + 5, area.right - 6.3 * s.labels[i].length) : 0;
      if (s.labels) add(g, "text", { class: "label", x: Math.max(beside, area.left + 2), y: sy(row) + 4 }, s.labels[i]);
    });
  },
  cells: (g, s, { sx, sy }, panel) => {
    const [x, x2, y, y2, v] = ["x", "x2", "y", "y2", "value"].map((n) => column(s[n]));
    v.forEach((value, i) => {
      if (!finite(value)) return;
      const strength = Math.min(Math.abs(value) / panel.largest, 1);
      add(g, "rect", { x: Math.min(sx(x[i]), sx(x2[i])), y: Math.min(sy(y[i]), sy(y2[i])), width: Math.abs(sx(x2[i]) - sx(x[i])) + 0.5, height: Math.abs(sy(y2[i]) - sy(y[i])) + 0.5, fill: colour(value < 0 ? "corrected" : "raw"), opacity: 0.06 + 0.94 * strength });
    });
  },
};

// What lies under the pointer: [head, rows, where] or nothing.
function under({ panel, series, scale }, px, py) {
  const { back, sx, sy } = scale, vx = panel.log_x ? 10 ** back.x(px) : back.x(px);
  const unit = (label) => (label.match(/\[(.*)\]/) || ["", ""])[1];
  for (const [from, to, text] of panel.spans || []) if (px >= sx(from) - 2 && px <= sx(to) + 2) return [`${panel.x_label.split(" [")[0]} ${shown(vx)} ${unit(panel.x_label)}`, [["dropped", text]], null];
  const flat = series.filter((s) => s.mark === "bars" || s.mark === "cells");
  for (const s of flat) {
    const at = (n) => column(s[n]);
    const i = at("x").findIndex((v, k) => {
      const high = s.mark === "bars" ? [sy(at("y")[k] - 0.4), sy(at("y")[k] + 0.4)] : [sy(at("y")[k]), sy(at("y2")[k])];
      const across = s.mark === "bars" && s.labels ? [scale.area.left, scale.area.right] : [sx(v), sx(at("x2")[k])];
      return px >= Math.min(...across) && px <= Math.max(...across) && py >= Math.min(...high) && py <= Math.max(...high);
    });
    if (i >= 0) return [s.text ? s.text[i] : panel.rows ? panel.rows[at("y")[i]] : panel.title || "", [[s.role, s.mark === "cells" ? `${s.name} ${shown(at("value")[i])}` : s.labels ? s.labels[i] : s.name]], null];
  }
  const lines = series.filter((s) => s.mark === "line" || s.mark === "dash" || s.mark === "band");
  if (!lines.length || panel.equal || panel.rows) return closest(series, scale, panel, px, py);
  const rows = lines.map((s) => { const i = nearest(column(s.x), vx); return [s, i]; }).filter(([, i]) => i >= 0);
  if (!rows.length) return null;
  const where = column(rows[0][0].x)[rows[0][1]], of = unit(panel.y_label || "");
  const words = rows.map(([s, i]) => [s.role, s.mark === "band" ? `${s.name} ${shown(column(s.y)[i])} to ${shown(column(s.y2)[i])} ${of}` : `${s.name} ${shown(column(s.y)[i])} ${of}`]);
  return [`${panel.x_label.split(" [")[0]} ${shown(where)} ${unit(panel.x_label)}`, words, sx(where)];
}
function closest(series, { sx, sy }, panel, px, py) {
  let best = null, least = 24;
  for (const s of series) {
    if (s.mark === "bars" || s.mark === "cells") continue;
    const xs = column(s.x), ys = column(s.y);
    for (let i = 0; i < xs.length; i++) {
      if (!finite(xs[i]) || !finite(ys[i])) continue;
      const far = Math.hypot(sx(xs[i]) - px, sy(ys[i]) - py);
      if (far < least) { least = far; best = [s, i]; }
    }
  }
  if (!best) return null;
  const [s, i] = best, place = panel.rows ? `${panel.rows[column(s.y)[i]]}: ${shown(column(s.x)[i])}` : `${shown(column(s.x)[i])}, ${shown(column(s.y)[i])}`;
  return [s.text ? s.text[i] : s.name, [[s.role, place]], null];
}

function listen(svg, drawn, state, chart, draw) {
  let start = null, box = null;
  const panelAt = ([px, py]) => drawn.find(({ scale: { area } }) => px >= area.left && px <= area.right && py >= area.top && py <= area.bottom);
  const lines = drawn.map(({ scale: { area } }) => add(svg, "line", { class: "cross", y1: area.top, y2: area.bottom, visibility: "hidden" }));
  const clear = () => { hideTip(); for (const line of lines) line.setAttribute("visibility", "hidden"); };
  svg.onpointermove = (event) => {
    const p = pointer(event, svg);
    if (start) {
      box ||= add(svg, "rect", { class: "zoom" });
      const [x0, x1] = [start[0], p[0]].sort((a, b) => a - b), [y0, y1] = tallBox(start, p);
      for (const [n, v] of Object.entries({ x: x0, y: y0, width: x1 - x0, height: y1 - y0 })) box.setAttribute(n, v);
      return;
    }
    const at = panelAt(p), found = at && under(at, ...p);
    clear();
    if (!found) return;
    showTip(event, found[0], found[1]);
    drawn.forEach((d, i) => {
      if (found[2] === null || (d !== at && !chart.shared)) return;
      lines[i].setAttribute("x1", found[2] - at.scale.area.left + d.scale.area.left);
      lines[i].setAttribute("x2", found[2] - at.scale.area.left + d.scale.area.left);
      lines[i].setAttribute("visibility", "visible");
    });
  };
  const tallBox = (a, b) => {
    const { panel, scale: { area } } = panelAt(a);
    return Math.abs(a[1] - b[1]) < 14 || panel.rows || chart.shared ? [area.top, area.bottom] : [a[1], b[1]].sort((m, n) => m - n);
  };
  svg.onpointerdown = (event) => { const p = pointer(event, svg); if (event.button === 0 && panelAt(p)) { start = p; svg.setPointerCapture(event.pointerId); clear(); } };
  svg.onpointercancel = () => { start = null; box?.remove(); box = null; };
  svg.onpointerup = (event) => {
    if (!start) return;
    const p = pointer(event, svg), at = panelAt(start), { back, area } = at.scale, [y0, y1] = tallBox(start, p);
    if (Math.abs(p[0] - start[0]) > 6) {
      const whole = y1 - y0 >= area.bottom - area.top - 1;
      const clamp = (v) => Math.min(Math.max(v, area.left), area.right);
      const x = [back.x(clamp(start[0])), back.x(clamp(p[0]))].sort((a, b) => a - b);
      state.view = { ...state.view, [at.key]: whole ? { x } : { x, y: [back.y(y1), back.y(y0)] } };
      draw();
    }
    start = null; box?.remove(); box = null;
  };
  svg.ondblclick = () => { state.view = {}; draw(); };
  svg.onpointerleave = clear;
}
