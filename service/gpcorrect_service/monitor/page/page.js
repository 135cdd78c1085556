"use strict";
// Shows snapshots as they come; keeps the last minute of each arm for the plots. Sends nothing.
const KEEP_SECONDS = 60, PATH_SECONDS = 20, QUIET_MS = 2000;
const cards = new Map();

const number = (value, digits, unit) => (value === null || value === undefined ? "–" : `${value.toFixed(digits)}${unit || ""}`);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const widest = (values) => { const known = values.filter((v) => v !== null); return known.length ? Math.max(...known) : null; };

function card(name) {
  if (!cards.has(name)) {
    document.getElementById("empty")?.remove();
    const root = document.getElementById("card").content.firstElementChild.cloneNode(true);
    root.id = `arm-${name}`;
    const at = Object.fromEntries([...root.querySelectorAll("[data-at]")].map((e) => [e.dataset.at, e]));
    cards.set(name, { root, at, past: [] });
    const main = document.getElementById("arms");
    const later = [...main.children].find((other) => other.id > root.id);
    main.insertBefore(root, later || null);
  }
  return cards.get(name);
}

function pill(element, text, kind) { element.textContent = text || ""; element.className = `pill ${kind || ""}`; }

// What an element says, grey and with its age where that is old.
function dated(element, text, age) {
  const old = Boolean(age && age.old);
  element.textContent = old ? `${text}, ${age.seconds.toFixed(0)} s ago` : text;
  element.classList.toggle("old", old);
}

function show(arm, now) {
  const { root, at, past } = card(arm.name);
  const c = arm.correction, wide = c && widest(c.interval_mm), turn = c && widest(c.interval_deg);
  root.classList.toggle("silent", arm.silent_seconds !== null && arm.silent_seconds > 2);
  at.name.textContent = arm.name;
  const since = c && c.age, stateOld = Boolean(arm.state_age && arm.state_age.old);
  pill(at.state, stateOld ? `${arm.operating_state} ${arm.state_age.seconds.toFixed(0)} s ago` : arm.operating_state, stateOld ? "" : arm.operating_state === "ENABLED" ? "good" : "bad");
  pill(at.homed, arm.is_homed === null ? "" : arm.is_homed ? "homed" : "not homed", stateOld ? "" : arm.is_homed ? "good" : "bad");
  pill(at.status, c && (since.old ? `${c.status} ${since.seconds.toFixed(0)} s ago` : c.status), c && since.old ? "" : c && c.status === "OK" ? "good" : "bad");
  pill(at.models, arm.models_differ ? "MODELS DIFFER" : "", "bad");
  pill(at.alarm, arm.drift.alarm ? "DRIFT" : "", "bad");
  dated(at.error, arm.error ? `${number(arm.error.mm, 2)} mm, ${number(arm.error.deg, 1)}°` : "–", arm.error && arm.error.age);
  dated(at.interval, c ? `± ${number(wide, 2)} mm, ${number(turn, 1)}°` : "–", since);
  dated(at.correction, c && c.mm !== null ? `${number(c.mm, 2)} mm, ${number(c.deg, 1)}°` : "–", since);
  at.outside.textContent = arm.outside_share === null ? "–" : `${(100 * arm.outside_share).toFixed(0)} %`;
  dated(at.latency, arm.latency_ms ? `${number(arm.latency_ms.median, 2)} / ${number(arm.latency_ms.p99, 2)} ms` : "–", since);
  at.cameras.hidden = !arm.view;
  if (arm.view) {
    dated(at.seen, "cameras", arm.view);
    // The next picture is asked for when the last one is there, and only while new ones come.
    if (!at.view.src || (!arm.view.old && at.view.complete)) at.view.src = `/view/${encodeURIComponent(arm.name)}?${now}`;
  }
  const served = arm.replicas[0];
  at.model.textContent = c ? `${c.model_id} ${c.model_hash}` : served ? `${served.model_id} ${served.model_hash}` : "–";
  at.model.title = at.model.textContent;
  rows(root.querySelector(".poses tbody"), Object.entries(arm.poses).filter(([, p]) => p).map(([what, p]) =>
    [what, ...p.mm.map((v) => number(v, 2)), ...p.deg.map((v) => number(v, 1)), p.age.old ? `${p.frame}, ${p.age.seconds.toFixed(0)} s ago` : p.frame]),
    Object.values(arm.poses).filter((p) => p).map((p) => p.age.old));
  rows(root.querySelector(".replicas tbody"), arm.replicas.map((r) =>
    [r.replica, r.state, `${r.model_id} ${r.model_hash}`, r.asked, r.outside_share === null ? "–" : `${(100 * r.outside_share).toFixed(0)} %`,
      r.faults, r.queued, `${number(r.round_trip_ms, 1)} ms`]));
  root.querySelector(".replicas").hidden = !arm.replicas.length;
  const full = Math.min(1, Math.max(0, Math.log(arm.drift.evidence) / Math.log(arm.drift.threshold)));
  at.drift.style.width = `${100 * full}%`;
  const { why, idle_seconds: idle } = arm.drift, none = idle === null ? "nothing compared" : `nothing compared for ${idle.toFixed(0)} s`;
  at.drift.className = arm.drift.alarm ? "bad" : "";
  at.drift.parentElement.parentElement.classList.toggle("old", Boolean(why));
  at.evidence.textContent = `${arm.drift.alarm ? "alarm: " : ""}evidence ${arm.drift.evidence.toPrecision(2)} of ${arm.drift.threshold.toExponential(0)}, ${arm.drift.votes} s compared${why ? `; ${none}: ${why}` : ""}`;
  const told = [arm.refused ? `${arm.refused} refused, last: ${arm.last_refusal}` : "", arm.unreadable ? `${arm.unreadable} unreadable, last: ${arm.last_unreadable}` : ""];
  at.refusal.textContent = told.filter(Boolean).join("; ");
  const fresh = c && !since.old;
  past.push({ now, error: arm.error && !arm.error.age.old ? arm.error.mm : null, wide: fresh ? wide : null, desired: arm.poses.desired && arm.poses.desired.mm, tracked: arm.poses.tracked && arm.poses.tracked.mm });
  while (past.length && past[0].now < now - KEEP_SECONDS) past.shift();
  drawPath(at.path, past.filter((p) => p.now > now - PATH_SECONDS));
  drawHistory(at.history, past, now);
}

function rows(body, table, old = []) {
  while (body.rows.length > table.length) body.deleteRow(-1);
  table.forEach((cells, i) => {
    const row = body.rows[i] || body.insertRow();
    row.classList.toggle("old", Boolean(old[i]));
    cells.forEach((text, j) => { (row.cells[j] || row.insertCell()).textContent = text; });
  });
}

function scaled(canvas) {
  const sharp = window.devicePixelRatio || 1, width = canvas.clientWidth, height = Math.round(width * 0.65);
  if (canvas.width !== width * sharp) { canvas.width = width * sharp; canvas.height = height * sharp; }
  const pen = canvas.getContext("2d");
  pen.setTransform(sharp, 0, 0, sharp, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "11px system-ui, sans-serif";
  return { pen, width, height };
}

function drawPath(canvas, past) {
  const { pen, width, height } = scaled(canvas);
  const all = past.flatMap((p) => [p.desired, p.tracked]).filter(Boolean);
  if (!all.length) return;
  // The plane in which most happens.
  const spread = [0, 1, 2].map((k) => Math.max(...all.map((p) => p[k])) - Math.min(...all.map((p) => p[k])));
  const drop = spread.indexOf(Math.min(...spread)), [i, j] = [0, 1, 2].filter((k) => k !== drop);
  const middle = [i, j].map((k) => (Math.max(...all.map((p) => p[k])) + Math.min(...all.map((p) => p[k]))) / 2);
  const scale = 0.8 * Math.min(width / Math.max(spread[i], 4), height / Math.max(spread[j], 4));
  const place = (p) => [width / 2 + scale * (p[i] - middle[0]), height / 2 - scale * (p[j] - middle[1])];
  for (const [what, dash] of [["desired", [5, 3]], ["tracked", []]]) {
    const path = past.map((p) => p[what]).filter(Boolean);
    if (!path.length) continue;
    pen.strokeStyle = pen.fillStyle = colour(what);
    pen.setLineDash(dash);
    pen.lineWidth = 1.4;
    pen.beginPath();
    path.forEach((p, n) => (n ? pen.lineTo(...place(p)) : pen.moveTo(...place(p))));
    pen.stroke();
    pen.setLineDash([]);
    pen.beginPath();
    pen.arc(...place(path[path.length - 1]), 3.5, 0, 7);
    pen.fill();
  }
  pen.fillStyle = pen.strokeStyle = colour("quiet");
  const tick = 10 ** Math.floor(Math.log10(width / scale / 3));
  pen.fillRect(10, height - 12, tick * scale, 2);
  pen.fillText(`${tick} mm, ${"xyz"[i]} and ${"xyz"[j]}`, 10, height - 18);
}

function drawHistory(canvas, past, now) {
  const { pen, width, height } = scaled(canvas);
  const top = 1.15 * Math.max(1, ...past.flatMap((p) => [p.error, p.wide]).filter((v) => v !== null && v !== undefined));
  const x = (t) => width - 8 - ((now - t) / KEEP_SECONDS) * (width - 40), y = (v) => height - 16 - (v / top) * (height - 26);
  pen.strokeStyle = colour("line"); pen.fillStyle = colour("quiet"); pen.lineWidth = 1;
  const step = [0.5, 1, 2, 5, 10, 20, 50, 100].find((s) => top / s <= 6) || 200;
  for (let v = 0; v <= top; v += step) {
    pen.beginPath(); pen.moveTo(30, y(v)); pen.lineTo(width - 8, y(v)); pen.stroke();
    pen.fillText(String(v), 6, y(v) + 4);
  }
  pen.textAlign = "center";
  for (let ago = 0; ago <= KEEP_SECONDS; ago += KEEP_SECONDS / 4) {
    const at = x(now - ago);
    pen.beginPath(); pen.moveTo(at, y(0)); pen.lineTo(at, y(top)); pen.stroke();
    pen.fillText(ago ? `−${ago} s` : "now", Math.max(Math.min(at, width - 14), 44), height - 3);
  }
  pen.textAlign = "left";
  for (const [what, key] of [["interval", "wide"], ["tracked", "error"]]) {
    pen.strokeStyle = colour(what); pen.lineWidth = 1.4; pen.beginPath();
    let open = false;
    for (const p of past) {
      if (p[key] === null || p[key] === undefined) { open = false; continue; }
      if (open) pen.lineTo(x(p.now), y(p[key])); else pen.moveTo(x(p.now), y(p[key]));
      open = true;
    }
    pen.stroke();
  }
}

function listen() {
  const link = document.getElementById("link"), stream = new EventSource("/events");
  let latest = performance.now();
  stream.onerror = () => pill(link, "not connected", "bad");
  stream.onmessage = (event) => {
    try {
      const snapshot = JSON.parse(event.data), now = performance.now() / 1000;
      document.getElementById("namespace").textContent = snapshot.namespace;
      snapshot.arms.forEach((arm) => show(arm, now));
      latest = performance.now();
      pill(link, "live", "good");
    } catch (error) {
      pill(link, `cannot be shown: ${error.message}`, "bad");
    }
  };
  setInterval(() => { if (performance.now() - latest > QUIET_MS) pill(link, `no news for ${((performance.now() - latest) / 1000).toFixed(0)} s`, "bad"); }, 500);
}
listen();
