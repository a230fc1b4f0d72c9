"use strict";

// The recordings of a campaign: sort by a column, find by a word, open by a click.

const COLUMNS = [
  ["case", "Case"],
  ["verdict", "Verdict"],
  ["passed", "Passed"],
  ["model", "Model"],
  ["hour", "Hour"],
  ["weather", "Weather"],
  ["complete", "Complete"],
  ["moment_s", "Opens at"],
];

let rows = [];
let order = { key: "case", descending: false };

function shown(row, key) {
  if (key === "moment_s") return row.moment;
  if (typeof row[key] === "boolean") return row[key] ? "yes" : "no";
  return row[key].replaceAll("_", " ");
}

function address(row) {
  return `/view?case=${encodeURIComponent(row.case)}#when=sim_time@+${row.moment_s}s`;
}

function cell(row, key) {
  const td = document.createElement("td");
  if (key === "case") {
    const link = document.createElement("a");
    link.href = address(row);
    link.textContent = row.case;
    td.append(link);
  } else {
    td.textContent = shown(row, key);
  }
  if (key === "verdict") td.className = row.verdict;
  return td;
}

function before(a, b) {
  const [x, y] = [a[order.key], b[order.key]];
  const first = x < y ? -1 : x > y ? 1 : a.case < b.case ? -1 : 1;
  return order.descending ? -first : first;
}

function draw() {
  const words = document.getElementById("find").value.toLowerCase().split(/\s+/);
  const matching = rows.filter((row) => {
    const text = COLUMNS.map(([key]) => shown(row, key)).join(" ").toLowerCase();
    return words.every((word) => text.includes(word));
  });
  matching.sort(before);
  const lines = matching.map((row) => {
    const tr = document.createElement("tr");
    tr.append(...COLUMNS.map(([key]) => cell(row, key)));
    return tr;
  });
  document.querySelector("#cases tbody").replaceChildren(...lines);
  document.getElementById("found").textContent = `${matching.length} of ${rows.length} recordings`;
  document.querySelectorAll("#cases th").forEach((th, index) => {
    const sort = order.descending ? "descending" : "ascending";
    th.setAttribute("aria-sort", COLUMNS[index][0] === order.key ? sort : "none");
  });
}

function heads() {
  return COLUMNS.map(([key, label]) => {
    const button = document.createElement("button");
    button.textContent = label;
    button.addEventListener("click", () => {
      order = { key, descending: order.key === key && !order.descending };
      draw();
    });
    const th = document.createElement("th");
    th.append(button);
    return th;
  });
}

async function start() {
  const answer = await fetch("about.json");
  if (!answer.ok) throw new Error(await answer.text());
  const about = await answer.json();
  rows = about.cases;
  document.title = document.getElementById("name").textContent = `Recordings of ${about.name}`;
  if (about.missing.length) {
    const text = `Without a recording: ${about.missing.join(", ")}`;
    document.getElementById("remarks").textContent = text;
  }
  document.querySelector("#cases thead tr").append(...heads());
  document.getElementById("find").addEventListener("input", draw);
  draw();
}

start().catch((error) => {
  document.getElementById("remarks").textContent = error.message;
});
