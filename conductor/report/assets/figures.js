// --- figures that come as they are: effects, resources, leases ---
at("no-effects").hidden = Boolean(data.effects);
at("interaction-section").hidden = !data.effects;
const FIGURES = [["residual", CONFIG], ["searched", CONFIG], ["boundary", CONFIG], ["effects", PLAIN], ["resources", PLAIN], ["leases", CONFIG]].filter(([id]) => data[id]);
function drawFigures() {
  for (const [id, config] of FIGURES) {
    const layout = themed(((NARROW.matches && data[`${id}_stacked`]) || data[id]).layout);
    const names = data[id].data.filter((trace) => trace.showlegend !== false && trace.name).map((trace) => trace.name);
    if (names.length && layout.showlegend !== false) placeLegend(layout, names, at(id), config === CONFIG ? LEGEND_BELOW_PX : 0, TITLE_PX[0]);
    Plotly.react(at(id), data[id].data, layout, config);
  }
  drawInteractions();
}
drawFigures();
for (const id of ["residual", "searched", "boundary", "leases"].filter((name) => data[name])) {
  at(id).on("plotly_click", (event) => {
    const clicked = /<b>(.*?)<\/b>/.exec(event.points[0].text ?? "");
    if (clicked && byId.has(clicked[1])) pick(clicked[1], true);
  });
}
