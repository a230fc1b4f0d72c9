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
const GRID_CASES_MAX = 400; // in the figure of all systems
const LINES_MANY = 24; // above this, thinner lines
const NARROW = matchMedia("(max-width: 700px)"); // figures are drawn below each other
const LEGEND_BELOW_PX = 30; // height of Plotly's tool bar
const [LEGEND_ENTRY_PX, LEGEND_CHAR_PX, LEGEND_ROW_PX] = [48, 7.2, 20];
const TITLE_PX = [26, 42]; // of the first row: one line, two lines
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

/** Room for the legend between tool bar and plots, whatever it holds: Plotly gives all entries the same width. */
function placeLegend(layout, entries, plot, barPx, titlePx) {
  const wide = LEGEND_ENTRY_PX + LEGEND_CHAR_PX * Math.max(...entries.map((text) => text.length));
  const room = Math.max(1, Math.floor((plot.clientWidth - layout.margin.l - layout.margin.r) / wide));
  const top = barPx + LEGEND_ROW_PX * Math.ceil(entries.length / room) + titlePx;
  layout.height += top - layout.margin.t;
  layout.margin.t = top;
  layout.legend = { ...layout.legend, orientation: "h", x: 0, yref: "container", y: 1 - barPx / layout.height, yanchor: "top" };
}

const PLAIN = { ...CONFIG, displayModeBar: false };
const option = (select, value, text) => {
  const element = document.createElement("option");
  element.value = value;
  element.textContent = text;
  select.append(element);
};
// Plotly reads its texts as markup.
const esc = (text) => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
const words = (text) => esc(String(text).replaceAll("_", " "));
