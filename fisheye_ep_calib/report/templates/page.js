"use strict";
// Sorts a table by the column whose heading is pressed; numbers by data-value, words as words.
for (const button of document.querySelectorAll("table.sortable th button")) {
  button.addEventListener("click", () => {
    const heading = button.closest("th"), table = heading.closest("table"), body = table.tBodies[0];
    const up = heading.getAttribute("aria-sort") !== "ascending", column = heading.cellIndex;
    for (const other of heading.parentNode.cells) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", up ? "ascending" : "descending");
    const key = (row) => row.cells[column].dataset.value ?? row.cells[column].textContent.trim();
    const compare = (a, b) => {
      const [x, y] = [parseFloat(key(a)), parseFloat(key(b))];
      if (Number.isNaN(x) && Number.isNaN(y)) return key(a).localeCompare(key(b), undefined, { numeric: true });
      return Number.isNaN(x) ? 1 : Number.isNaN(y) ? -1 : x - y;
    };
    const words = [...body.rows].some((row) => row.cells[column].dataset.value === undefined);
    const order = words ? (a, b) => key(a).localeCompare(key(b), undefined, { numeric: true }) : compare;
    body.append(...[...body.rows].sort((a, b) => (up ? order(a, b) : order(b, a))));
  });
}
// Shows a figure or a view as large as the window allows.
const viewer = document.getElementById("viewer"), stage = viewer.querySelector(".stage");
for (const button of document.querySelectorAll("[data-enlarge]")) {
  button.addEventListener("click", () => {
    const source = document.getElementById(button.dataset.enlarge);
    stage.replaceChildren(source.querySelector(".canvas").cloneNode(true));
    viewer.querySelector("p").textContent = source.querySelector("figcaption").innerText.replace(/\s+/g, " ");
    viewer.showModal();
  });
}
viewer.addEventListener("click", (event) => { if (!event.target.closest(".canvas")) viewer.close(); });
// Paper cannot be clicked: what is folded is printed unfolded.
let folded = [];
addEventListener("beforeprint", () => {
  folded = [...document.querySelectorAll("details:not([open])")];
  for (const one of folded) one.open = true;
});
addEventListener("afterprint", () => { for (const one of folded) one.open = false; });
