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
for (const button of document.querySelectorAll("button.case")) {
  button.addEventListener("click", () => pick(button.dataset.pick, true));
}
