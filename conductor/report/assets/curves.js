// --- curves ---
const unpacked = new Map();
function floats(text) {
  if (!unpacked.has(text)) {
    const bytes = Uint8Array.from(atob(text), (char) => char.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    unpacked.set(text, Float32Array.from({ length: bytes.length / 4 }, (_, i) => view.getFloat32(4 * i, true)));
  }
  return unpacked.get(text);
}

/** One trace holds all cases of a group, with a gap between two cases: few traces stay fast. */
function traces(cases, row, axis, style) {
  const length = cases.reduce((sum, c) => sum + floats(c.time_s).length + 1, 0);
  const x = new Float32Array(length).fill(NaN);
  const y = new Float32Array(length).fill(NaN);
  const text = new Array(length).fill("");
  let start = 0;
  for (const c of cases) {
    const time = floats(c.time_s);
    x.set(time, start);
    y.set(floats(c.values[row]), start);
    text.fill(c.id, start, start + time.length);
    start += time.length + 1;
  }
  const shape = STEPPED.has(data.curves[row]) ? "hv" : "linear";
  return {
    type: "scatter", mode: "lines", connectgaps: false, x, y, text, xaxis: `x${axis}`, yaxis: `y${axis}`,
    name: style.name, legendgroup: style.group, showlegend: style.legend,
    // Transparent paint instead of a transparent trace: that would be a layer per trace.
    line: { color: style.color + style.alpha, dash: style.dash, width: style.width, shape },
    hovertemplate: "%{text}<br>%{x:.2f} s: %{y:.3f}<extra></extra>",
  };
}

/** Distributions over many cases in the panel of a curve; see spread.py. */
function spreads(name, model, axis) {
  const { cases, time_s, values } = data.spread[model];
  const [time, rows] = [floats(time_s), values[name].map(floats)];
  const known = [...time.keys()].filter((i) => Number.isFinite(rows[0][i]));
  const percent = (value) => `${Math.round(100 * value)} %`;
  const trace = (row, more) => ({
    type: "scatter", mode: "lines", x: known.map((i) => time[i]), y: known.map((i) => rows[row][i]),
    xaxis: `x${axis}`, yaxis: `y${axis}`, name: esc(data.names[model]), showlegend: false, hoverinfo: "skip", ...more,
  });
  const hover = (said) => ({ hoverinfo: "text", hovertext: known.map((i) => `${time[i].toFixed(1)} s: ${said(i)}`) });
  const ink = name === "collisions" ? data.collision_color : color("--spread");
  if (rows.length === 1) {
    const of = name === "collisions" ? `all ${cases} cases` : "the running cases";
    return [trace(0, { line: { color: ink, width: 1.5 }, fill: "tozeroy", fillcolor: `${ink}44`, ...hover((i) => `${percent(rows[0][i])} of ${of}`) })];
  }
  const none = { line: { width: 0, color: ink } };
  const band = (opacity) => ({ ...none, fill: "tonexty", fillcolor: ink + opacity });
  const said = (i) => `median ${rows[2][i].toFixed(2)}<br>half of the cases ${rows[1][i].toFixed(2)} to ${rows[3][i].toFixed(2)}` +
    `<br>90 % of the cases ${rows[0][i].toFixed(2)} to ${rows[4][i].toFixed(2)}`;
  return [trace(0, none), trace(4, band("2a")), trace(1, none), trace(3, band("55")), trace(2, { line: { color: ink, width: 2 }, ...hover(said) })];
}

/** A cross where each collision happened, on the distance and on the count. */
function impacts(cases, panels, legend) {
  const count = data.curves.indexOf("collisions");
  const hits = cases.map((c) => [c, floats(c.values[count]).findIndex((n) => n > 0)]).filter(([, i]) => i >= 0);
  if (!hits.length) return [];
  return panels.filter(([row]) => ["dtc_m", "collisions"].includes(data.curves[row])).map(([row, axis], n) => ({
    type: "scatter", mode: "markers", x: hits.map(([c, i]) => floats(c.time_s)[i]),
    y: hits.map(([c, i]) => floats(c.values[row])[i]), text: hits.map(([c]) => c.id),
    xaxis: `x${axis}`, yaxis: `y${axis}`, name: "collision", legendgroup: " collision",
    showlegend: legend && n === 0, marker: { symbol: "x", size: 8, color: data.collision_color },
    hovertemplate: "%{text}<br>collision at %{x:.2f} s<extra></extra>",
  }));
}

/** Curves of `cases` of `model` in `panels`, pairs of a curve and the number of its axes. */
function drawCases(cases, model, all, group, lit, named) {
  const spread = (row) => data.spread[model]?.values[data.curves[row]] !== undefined;
  const found = all.filter(([row]) => spread(row)).flatMap(([row, axis]) => spreads(data.curves[row], model, axis));
  const panels = all.filter(([row]) => !spread(row));
  const width = cases.length > LINES_MANY ? 0.8 : 1.5;
  for (const [value, [hue, dash]] of Object.entries(group.styles)) {
    const members = cases.filter((c) => c.groups[group.axis] === value);
    if (!members.length) continue;
    const style = { group: value, color: hue, dash, width, alpha: lit ? "55" : "dd" };
    style.name = group.axis === "model" ? esc(data.names[value]) : words(value);
    panels.forEach(([row, axis], n) => found.push(traces(members, row, axis, { ...style, legend: n === 0 && !named.has(value) })));
    named.add(value);
  }
  if (lit && cases.includes(lit)) {
    const style = { name: esc(lit.id), group: " picked", color: color("--ink"), dash: "solid", width: 3, alpha: "" };
    all.forEach(([row, axis], n) => found.push(traces([lit], row, axis, { ...style, legend: n === 0 })));
  }
  const crosses = impacts(cases, panels, !named.has(" collision"));
  if (crosses.length) named.add(" collision");
  return [...found, ...crosses];
}

function selected() {
  const model = at("pick-model").value;
  return data.cases.filter((c) => c.time_s && (!model || c.model === model));
}

const axisName = (number) => (number > 1 ? String(number) : "");

function draw() {
  const group = data.groups[Number(at("pick-group").value)];
  const model = at("pick-model").value;
  const star = byId.get(picked);
  const lit = star && star.time_s ? star : null;
  const named = new Set();
  let drawn = [];
  if (model) {
    drawn = drawCases(selected(), model, data.curves.map((_, row) => [row, axisName(row + 1)]), group, lit, named);
  } else {
    const wanted = data.grid_curves.map((name) => data.curves.indexOf(name));
    data.grid_models.forEach((name, line) => {
      const own = selected().filter((c) => c.model === name);
      const panels = wanted.map((row, n) => [row, axisName(line * wanted.length + n + 1)]);
      drawn.push(...drawCases(own, name, panels, group, lit, named));
    });
  }
  const layout = themed(model ? data.frame : NARROW.matches ? data.grid_stacked : data.grid);
  layout.uirevision = `${model}/${group.axis}`; // keeps zoom and hidden groups
  layout.legend.title = { text: `${esc(group.label)}  ` };
  placeLegend(layout, [group.label, ...named], curves, NARROW.matches ? 0 : LEGEND_BELOW_PX, TITLE_PX[Number(NARROW.matches && !model)]);
  if (at("near").checked) {
    const near = model ? [data.curves.indexOf("dtc_m") + 1]
      : data.grid_models.map((_, line) => line * data.grid_curves.length + data.grid_curves.indexOf("dtc_m") + 1);
    for (const number of near) Object.assign(layout[`yaxis${axisName(number)}`], { range: [0, 10], uirevision: "near" });
  }
  if (data.cases.some((c) => c.time_s)) Plotly.react(curves, drawn, layout, CONFIG);
  at("picked").textContent = told(star, selected().length);
}

function told(star, shown) {
  const head = `${shown} ${shown === 1 ? "case" : "cases"} with recorded KPIs drawn.`;
  const left = !at("pick-model").value && data.models.length > data.grid_models.length
    ? ` The first ${data.grid_models.length} systems are shown; choose another one by name.` : "";
  if (!star) return head + left;
  const tail = star.time_s ? "highlighted" : "no KPI rows were recorded, or they are damaged";
  return `${head}${left} ${star.id} (${star.status.replaceAll("_", " ")}): ${tail}.`;
}

function pick(id, scroll) {
  const found = byId.get(id);
  picked = found ? id : "";
  const model = at("pick-model");
  if (found && model.value && model.value !== found.model) model.value = found.model;
  at("pick-case").value = picked;
  for (const row of document.querySelectorAll("#cases tbody tr")) {
    row.setAttribute("aria-selected", String(row.dataset.case === picked));
  }
  draw();
  if (scroll) at("curve-section").scrollIntoView({ block: "start" });
}

option(at("pick-model"), "", `all (${data.models.length})`);
data.models.forEach((model) => option(at("pick-model"), model, data.names[model]));
// The only system is drawn large; thousands of lines take long to draw: begin with one, too.
if (data.models.length === 1 || data.cases.length > GRID_CASES_MAX || NARROW.matches) at("pick-model").value = data.models[0];
data.groups.forEach((group, index) => option(at("pick-group"), String(index), group.label));
option(at("pick-case"), "", "no case");
data.cases.forEach((c) => option(at("pick-case"), c.id, `${c.id}: ${c.status.replaceAll("_", " ")}`));
at("pick-model").addEventListener("change", () => {
  const found = byId.get(picked);
  const model = at("pick-model").value;
  if (found && model && found.model !== model) pick("", false);
  else draw();
});
at("pick-group").addEventListener("change", draw);
at("near").addEventListener("change", draw);
at("pick-case").addEventListener("change", () => pick(at("pick-case").value, false));
draw();
if (curves.on) curves.on("plotly_click", (event) => byId.has(event.points[0].text) && pick(event.points[0].text, false));
