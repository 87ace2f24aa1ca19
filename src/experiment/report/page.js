"use strict";
// A click on a heading sorts its table by that column, another one the other way round. What is undefined stays last.
for (const button of document.querySelectorAll("th button")) {
  button.addEventListener("click", () => {
    const heading = button.closest("th");
    const place = heading.cellIndex;
    const rising = heading.getAttribute("aria-sort") !== "ascending";
    for (const other of heading.parentElement.cells) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", rising ? "ascending" : "descending");
    const body = heading.closest("table").tBodies[0];
    const value = (row) => {
      const cell = row.cells[place];
      return "value" in cell.dataset ? cell.dataset.value : cell.textContent;
    };
    const isNumber = (row) => "value" in row.cells[place].dataset;
    const compare = (one, two) => {
      const [a, b] = [value(one), value(two)];
      if (a === "" || b === "") return (a === "") - (b === "");
      const order = isNumber(one) ? Number(a) - Number(b) : a.localeCompare(b);
      return rising ? order : -order;
    };
    body.append(...[...body.rows].sort(compare));
  });
}
