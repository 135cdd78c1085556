// Tables sort by a click on a column's name (a third click: as it came); rows with a key choose what the charts show.
const numberOf = (text) => parseFloat(text.replace(/[\s ]/g, "").replace("−", "-").replace("<", ""));

function sortable(table) {
  const body = table.tBodies[0], came = [...body.rows];
  if (came.length < 3) return;
  [...table.tHead.rows[0].cells].forEach((cell, i) => {
    const text = cell.textContent;
    if (!text) return;
    cell.textContent = "";
    add(cell, "button", { type: "button", title: `Sort by ${text}` }, text).onclick = () => {
      const order = { none: "ascending", ascending: "descending", descending: "none" }[cell.getAttribute("aria-sort") || "none"];
      for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
      if (order !== "none") cell.setAttribute("aria-sort", order);
      body.replaceChildren(...(order === "none" ? came : sorted(came, i, order === "descending" ? -1 : 1)));
    };
  });
}

function sorted(rows, i, sign) {
  const value = rows.map((row) => [row, row.cells[i].textContent.trim()]);
  const numeric = value.every(([, text]) => ["", "-", "–"].includes(text) || Number.isFinite(numberOf(text)));
  const compare = (a, b) => {
    if (!numeric) return sign * a.localeCompare(b, "en", { numeric: true });
    const [m, n] = [numberOf(a), numberOf(b)];
    return Number.isNaN(m) ? 1 : Number.isNaN(n) ? -1 : sign * (m - n); // what has no number stays last
  };
  return value.sort((a, b) => compare(a[1], b[1])).map(([row]) => row);
}

function selectable(table) {
  for (const row of table.querySelectorAll("tr[data-key]")) {
    row.tabIndex = 0;
    row.onclick = () => choose(row.dataset.key);
    row.onkeydown = (event) => {
      const next = { ArrowDown: row.nextElementSibling, ArrowUp: row.previousElementSibling, Enter: row, " ": row }[event.key];
      if (!next) return;
      event.preventDefault();
      next.focus();
      choose(next.dataset.key);
    };
  }
}

for (const table of document.querySelectorAll("table")) { sortable(table); selectable(table); }
for (const figure of document.querySelectorAll(".chart")) {
  const chart = DATA.charts[Number(figure.dataset.chart)];
  (chart.space ? space : plot)(figure, chart);
}
const first = DATA.chosen || document.querySelector("tr[data-key]")?.dataset.key;
if (first) {
  choose(first);
  const row = document.querySelector("tr[aria-selected=true]"), box = row?.closest(".scroll");
  if (box) box.scrollTop = row.offsetTop - box.clientHeight / 2; // the page itself stays at its top
}
