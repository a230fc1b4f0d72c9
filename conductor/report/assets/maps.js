// --- heat maps: any two axes, and a map per value of a third ---
const all = data.all;
const AXES = Object.keys(all.axes);
const HOVER_CASES = 6;
const MAPS_MAX = 24;
const MAP_ROW_PX = 34;
const MAP_LEFT_PX = 96;
const CELL_CHAR_PX = 7;
const STATUS_SCALE = all.statuses.flatMap((s, i) => [
  [i / all.statuses.length, s.color], [(i + 1) / all.statuses.length, s.color],
]);

function cellText(cell, worst, room) {
  const symbol = all.statuses[all.status[worst]].symbol;
  const number = cell.length === 1 ? all.number[worst] : `${cell.filter((n) => all.passed[n] === 1).length}/${cell.length}`;
  const text = `${symbol} ${number}`.trimEnd();
  return text.length * CELL_CHAR_PX > room ? symbol : text; // where it does not fit, hovering tells it
}

function cellHover(cell) {
  const lines = cell.slice(0, HOVER_CASES).map((n) => `<b>${esc(all.ids[n])}</b><br>${all.hover[n]}`);
  if (cell.length > HOVER_CASES) lines.push(`and ${cell.length - HOVER_CASES} more`);
  return lines.join("<br>");
}

function heatMap(members, xAxis, yAxis, width) {
  const [across, down] = [all.axes[xAxis], all.axes[yAxis]];
  const cells = down.values.map(() => across.values.map(() => []));
  for (const n of members) cells[down.of[n]][across.of[n]].push(n);
  const over = (said) => cells.map((line) => line.map((cell) => {
    if (!cell.length) return null;
    const worst = cell.reduce((a, b) => (all.severity[b] < all.severity[a] ? b : a));
    return said(cell, worst);
  }));
  const room = (width - MAP_LEFT_PX) / across.values.length - 6;
  const trace = {
    type: "heatmap", x: across.values.map(words), y: down.values.map(words),
    z: over((_, worst) => all.status[worst]), text: over((cell, worst) => cellText(cell, worst, room)), textfont: { size: 12 },
    hovertext: over((cell) => cellHover(cell)), customdata: over((_, worst) => all.ids[worst]),
    texttemplate: "%{text}", hovertemplate: "%{hovertext}<extra></extra>", hoverongaps: false,
    zmin: -0.5, zmax: all.statuses.length - 0.5, colorscale: STATUS_SCALE, showscale: false, xgap: 2, ygap: 2,
  };
  const layout = {
    height: Math.max(210, 92 + MAP_ROW_PX * down.values.length), margin: { l: MAP_LEFT_PX, r: 8, t: 8, b: 52 },
    xaxis: { title: { text: esc(across.label) }, type: "category", showgrid: false },
    yaxis: { title: { text: esc(down.label), standoff: 14 }, type: "category", autorange: "reversed", showgrid: false },
  };
  return { data: [trace], layout };
}

let maps = [];
function fillMaps(drawn) {
  const [xAxis, yAxis] = [at("heat-x").value, at("heat-y").value];
  for (const { plot, members } of maps) {
    const map = heatMap(members, xAxis, yAxis, plot.clientWidth);
    drawn(plot, map.data, themed(map.layout), PLAIN);
  }
}
function drawMaps() {
  const [xAxis, yAxis, per] = ["heat-x", "heat-y", "heat-per"].map((id) => at(id).value);
  for (const { plot } of maps) Plotly.purge(plot);
  at("heat").replaceChildren();
  const everyone = all.ids.map((_, n) => n);
  const parts = per
    ? all.axes[per].values.map((title, v) => [title, everyone.filter((n) => all.axes[per].of[n] === v)])
    : [["All cases", everyone]];
  maps = parts.slice(0, MAPS_MAX).map(([title, members]) => {
    const figure = document.createElement("figure");
    const head = document.createElement("h3");
    const plot = document.createElement("div");
    head.textContent = title;
    figure.append(head, plot);
    at("heat").append(figure);
    return { plot, members };
  });
  if (parts.length > MAPS_MAX) at("heat").append(`and ${parts.length - MAPS_MAX} more maps`);
  // Drawn when all have their place: the width of one depends on how many there are.
  fillMaps(Plotly.newPlot);
  for (const { plot } of maps) {
    plot.on("plotly_click", (event) => event.points[0].customdata && pick(event.points[0].customdata, true));
  }
}

for (const id of ["heat-x", "heat-y"]) AXES.forEach((axis) => option(at(id), axis, all.axes[axis].label));
option(at("heat-per"), "", "no axis");
AXES.forEach((axis) => option(at("heat-per"), axis, all.axes[axis].label));
at("heat-x").value = data.heat.x;
at("heat-y").value = data.heat.y;
at("heat-per").value = data.heat.per;
for (const id of ["heat-x", "heat-y", "heat-per"]) at(id).addEventListener("change", drawMaps);
drawMaps();

// --- main effects and interactions ---
const CYCLE = ["#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#8C8C8C", "#8E4585"];
const DASHES = ["solid", "dash", "dot", "dashdot"];
const median = (sorted) => (sorted[(sorted.length - 1) >> 1] + sorted[sorted.length >> 1]) / 2;

/** Share of passed cases [%], or the median of a number, and what it is made of. */
function summary(members, measure) {
  if (measure < 0) {
    const decided = members.filter((n) => all.passed[n] >= 0);
    const passed = decided.filter((n) => all.passed[n] === 1).length;
    return decided.length ? [(100 * passed) / decided.length, `${passed} of ${decided.length} passed`] : [null, ""];
  }
  const known = members.map((n) => all.measures[measure].values[n]).filter((v) => v !== null).sort((a, b) => a - b);
  return known.length ? [median(known), `median of ${known.length}: ${median(known).toPrecision(4)}`] : [null, ""];
}

function drawInteractions() {
  if (!data.effects) return;
  const measure = Number(at("effect-measure").value);
  const [xAxis, by] = [at("effect-x").value, at("effect-by").value];
  const across = all.axes[xAxis];
  const lines = by ? all.axes[by].values : ["all cases"];
  const traces = lines.map((name, line) => {
    const members = across.values.map(() => []);
    all.ids.forEach((_, n) => (!by || all.axes[by].of[n] === line) && members[across.of[n]].push(n));
    const found = members.map((cell) => summary(cell, measure));
    const hue = CYCLE[line % CYCLE.length];
    const dash = DASHES[Math.floor(line / CYCLE.length) % DASHES.length];
    return {
      type: "scatter", mode: "lines+markers", name: words(name), x: across.values.map(words), y: found.map(([v]) => v),
      text: found.map(([, said]) => said), line: { color: hue, dash, width: 1.5 }, marker: { size: 7, color: hue },
      hovertemplate: `%{x}<br>%{fullData.name}<br>%{text}<extra></extra>`,
    };
  });
  const title = measure < 0 ? "passed [%]" : `${all.measures[measure].label}, median`;
  const layout = {
    height: 360, margin: { l: 64, r: 12, t: 12, b: 60 }, hovermode: "closest", showlegend: Boolean(by),
    xaxis: { title: { text: esc(across.label) }, type: "category" }, legend: {},
    yaxis: { title: { text: title }, ...(measure < 0 ? { range: [-4, 104] } : { rangemode: "tozero" }) },
  };
  if (by) placeLegend(layout, lines.map(String), at("interactions"), 0, 10);
  Plotly.react(at("interactions"), traces, themed(layout), PLAIN);
}

option(at("effect-measure"), "-1", "passed [%]");
all.measures.forEach((m, i) => option(at("effect-measure"), String(i), m.label));
AXES.forEach((axis) => option(at("effect-x"), axis, all.axes[axis].label));
option(at("effect-by"), "", "no axis");
AXES.forEach((axis) => option(at("effect-by"), axis, all.axes[axis].label));
const varies = (axis) => AXES.includes(axis) && all.axes[axis].values.length > 1;
const over = varies(data.heat.y) || !varies(data.heat.x) ? data.heat.y : data.heat.x;
at("effect-x").value = over;
at("effect-by").value = ["model", data.heat.x, data.heat.y].find((axis) => axis !== over && varies(axis)) ?? "";
for (const id of ["effect-measure", "effect-x", "effect-by"]) at(id).addEventListener("change", drawInteractions);
