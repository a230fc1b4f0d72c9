// --- dark mode and print ---
function restyle() {
  fillMaps(Plotly.react);
  draw();
  drawFigures();
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", restyle);
NARROW.addEventListener("change", restyle);
const wide = () => [...FIGURES.map(([id]) => id), ...(data.effects ? ["interactions"] : [])].map(at);
addEventListener("beforeprint", () => {
  restyle();
  for (const { plot } of maps) Plotly.relayout(plot, { width: PRINT_WIDTH_PX / 2 });
  if (curves.on) Plotly.relayout(curves, { width: PRINT_WIDTH_PX, height: PRINT_HEIGHT_PX });
  for (const plot of wide()) Plotly.relayout(plot, { width: PRINT_WIDTH_PX });
});
addEventListener("afterprint", () => {
  restyle();
  for (const { plot } of maps) Plotly.relayout(plot, { width: null, autosize: true });
  if (curves.on) Plotly.relayout(curves, { width: null, autosize: true });
  for (const plot of wide()) Plotly.relayout(plot, { width: null, autosize: true });
});
