"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const byId = new Map(data.cases.map((c) => [c.id, c]));
  const STEPPED = new Set(["aeb", "collisions", "throttle", "brake"]);
    // Plotly offers to upload a chart to its cloud; results stay where they are.
  const CONFIG = {
    displaylogo: false, responsive: true, plotlyServerURL: "",
    modeBarButtonsToRemove: ["sendChartToCloud", "select2d", "lasso2d"],
  };
  const PRINT_WIDTH_PX = 1000; // A4 landscape between the margins of page.css
  const PRINT_HEIGHT_PX = 640;
  const LINES_MANY = 24; // above this, thinner lines
  const at = (id) => document.getElementById(id);
  const curves = at("curves");
  let picked = "";

  // --- colours follow the page's style sheet, so that dark mode and print stay one decision ---
  const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  function themed(layout) {
    const result = structuredClone(layout);
    result.font = { family: getComputedStyle(document.body).fontFamily, size: 12, color: color("--ink") };
    result.paper_bgcolor = "rgba(0,0,0,0)";
    result.plot_bgcolor = "rgba(0,0,0,0)";
    result.modebar = { bgcolor: "rgba(0,0,0,0)", color: color("--dim"), activecolor: color("--ink") };
    result.hoverlabel = { bgcolor: color("--panel"), bordercolor: color("--line"), font: { color: color("--ink") }, align: "left" };
    for (const shape of result.shapes ?? []) shape.line.color = color("--alarm");
    for (const note of result.annotations ?? []) if (note.font.color) note.font.color = color("--alarm");
    for (const key of Object.keys(result)) {
      if (!/^[xy]axis\d*$/.test(key)) continue;
      Object.assign(result[key], { gridcolor: color("--grid"), zerolinecolor: color("--line"), linecolor: color("--line"), automargin: true });
      if (key[0] === "y") result[key].fixedrange = false;
    }
    return result;
  }

  // --- heat maps ---
  const maps = data.heat.map((map) => {
    const figure = document.createElement("figure");
    const title = document.createElement("h3");
    const plot = document.createElement("div");
    title.textContent = map.title;
    figure.append(title, plot);
    at("heat").append(figure);
    return { plot, map };
  });
  // Drawn when all have their place: the width of one depends on how many there are.
  for (const { plot, map } of maps) {
    Plotly.newPlot(plot, map.data, themed(map.layout), { ...CONFIG, displayModeBar: false });
    plot.on("plotly_click", (event) => event.points[0].customdata && pick(event.points[0].customdata, true));
  }

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
  function traces(cases, row, style) {
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
    const axis = row ? row + 1 : "";
    return {
      type: "scatter", mode: "lines", connectgaps: false, x, y, text, xaxis: `x${axis}`, yaxis: `y${axis}`,
      name: style.name, legendgroup: style.group, showlegend: row === 0,
      // Transparent paint instead of a transparent trace: that would be a layer per trace.
      line: { color: style.color + style.alpha, dash: style.dash, width: style.width, shape },
      hovertemplate: "%{text}<br>%{x:.2f} s: %{y:.3f}<extra></extra>",
    };
  }

  /** A cross where each collision happened, on the distance and on the count. */
  function impacts(cases) {
    const count = data.curves.indexOf("collisions");
    const hits = cases.map((c) => [c, floats(c.values[count]).findIndex((n) => n > 0)]).filter(([, i]) => i >= 0);
    if (!hits.length) return [];
    return ["dtc_m", "collisions"].map((name, n) => {
      const row = data.curves.indexOf(name);
      return {
        type: "scatter", mode: "markers", x: hits.map(([c, i]) => floats(c.time_s)[i]),
        y: hits.map(([c, i]) => floats(c.values[row])[i]), text: hits.map(([c]) => c.id),
        xaxis: `x${row + 1}`, yaxis: `y${row + 1}`, name: `collision (${hits.length})`, legendgroup: " collision",
        showlegend: n === 0, marker: { symbol: "x", size: 8, color: data.collision_color },
        hovertemplate: "%{text}<br>collision at %{x:.2f} s<extra></extra>",
      };
    });
  }

  function selected() {
    const model = at("pick-model").value;
    return data.cases.filter((c) => c.time_s && (!model || c.model === model));
  }

  function draw() {
    const group = data.groups[Number(at("pick-group").value)];
    const cases = selected();
    const star = byId.get(picked);
    const lit = star && star.time_s ? star : null;
    const width = cases.length > LINES_MANY ? 1 : 1.5;
    const drawn = [];
    for (const [value, [hue, dash]] of Object.entries(group.styles)) {
      const members = cases.filter((c) => c.groups[group.axis] === value);
      if (!members.length) continue;
      const name = `${value.replaceAll("_", " ")} (${members.length})`;
      const style = { name, group: value, color: hue, dash, width, alpha: lit ? "55" : "dd" };
      data.curves.forEach((_, row) => drawn.push(traces(members, row, style)));
    }
    if (lit) {
      const style = { name: lit.id, group: " picked", color: color("--ink"), dash: "solid", width: 3, alpha: "" };
      data.curves.forEach((_, row) => drawn.push(traces([lit], row, style)));
    }
    drawn.push(...impacts(cases));
    const layout = themed(data.frame);
    layout.uirevision = `${at("pick-model").value}/${group.axis}`; // keeps zoom and hidden groups
    layout.legend.title = { text: `${group.label}  ` };
    if (at("near").checked) {
      Object.assign(layout[`yaxis${data.curves.indexOf("dtc_m") + 1}`], { range: [0, 10], uirevision: "near" });
    }
    Plotly.react(curves, drawn, layout, CONFIG);
    at("picked").textContent = told(star, cases.length);
  }

  function told(star, shown) {
    const head = `${shown} ${shown === 1 ? "case" : "cases"} with recorded KPIs drawn.`;
    if (!star) return head;
    const tail = star.time_s ? "highlighted" : "no KPI rows were recorded, or they are damaged";
    return `${head} ${star.id} (${star.status.replaceAll("_", " ")}): ${tail}.`;
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

  function option(select, value, text) {
    const element = document.createElement("option");
    element.value = value;
    element.textContent = text;
    select.append(element);
  }
  option(at("pick-model"), "", `all (${data.models.length})`);
  data.models.forEach((model) => option(at("pick-model"), model, model));
  // Many cases over each other show little: begin with one system under test.
  if (data.cases.length > 32) at("pick-model").value = data.models[0];
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
  curves.on("plotly_click", (event) => pick(event.points[0].text, false));

  // --- resources ---
  function drawResources() {
    if (data.resources) Plotly.react(at("resources"), data.resources.data, themed(data.resources.layout), { ...CONFIG, displayModeBar: false });
  }
  drawResources();

  // --- the case table ---
  const body = document.querySelector("#cases tbody");
  const heads = [...document.querySelectorAll("#cases thead th")];
  const key = (row, column) => row.cells[column].dataset.sort ?? row.cells[column].textContent;
  function sort(column) {
    const down = heads[column].getAttribute("aria-sort") === "ascending";
    heads.forEach((head, i) => head.setAttribute("aria-sort", i === column ? (down ? "descending" : "ascending") : "none"));
    const order = (a, b) => {
      const [x, y] = [key(a, column), key(b, column)];
      if (!x || !y) return Number(!x) - Number(!y); // missing values last, both ways
      const [p, q] = [Number(x), Number(y)];
      const sign = Number.isNaN(p) || Number.isNaN(q) ? x.localeCompare(y) : p - q;
      return down ? -sign : sign;
    };
    body.append(...[...body.rows].sort(order));
  }
  heads.forEach((head, column) => head.querySelector("button").addEventListener("click", () => sort(column)));
  body.addEventListener("click", (event) => {
    const row = event.target.closest("tr");
    if (row) pick(row.dataset.case === picked ? "" : row.dataset.case, row.dataset.case !== picked);
  });
  body.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && event.target.matches("tr")) pick(event.target.dataset.case, true);
  });
  function find() {
    const wanted = at("find").value.trim().toLowerCase();
    let count = 0;
    for (const row of body.rows) {
      row.hidden = !row.textContent.toLowerCase().includes(wanted);
      count += Number(!row.hidden);
    }
    at("found").textContent = `${count} of ${body.rows.length} cases`;
  }
  at("find").addEventListener("input", find);
  find();

  // --- dark mode and print ---
  function restyle() {
    for (const { plot, map } of maps) Plotly.react(plot, map.data, themed(map.layout), { ...CONFIG, displayModeBar: false });
    draw();
    drawResources();
  }
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", restyle);
  addEventListener("beforeprint", () => {
    restyle();
    for (const { plot } of maps) Plotly.relayout(plot, { width: PRINT_WIDTH_PX / 2 });
    Plotly.relayout(curves, { width: PRINT_WIDTH_PX, height: PRINT_HEIGHT_PX });
    if (data.resources) Plotly.relayout(at("resources"), { width: PRINT_WIDTH_PX });
  });
  addEventListener("afterprint", () => {
    restyle();
    for (const { plot } of maps) Plotly.relayout(plot, { width: null, autosize: true });
    Plotly.relayout(curves, { width: null, autosize: true });
    if (data.resources) Plotly.relayout(at("resources"), { width: null, autosize: true });
  });
})();
