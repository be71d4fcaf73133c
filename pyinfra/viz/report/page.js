"use strict";
/* A click on the head of a column sorts the table by this column. Cells without a value are last. */
for (const table of document.querySelectorAll("table")) {
  const heads = [...table.querySelectorAll("thead th")];
  heads.forEach((head, place) => head.querySelector("button")?.addEventListener("click", () => {
    const up = head.getAttribute("aria-sort") !== "ascending";
    heads.forEach((other) => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    sortRows(table.tBodies[0], place, up, head.classList.contains("number"));
  }));
}

function sortRows(body, place, up, numbers) {
  const key = (row) => row.cells[place].dataset.sort;
  const order = numbers ? (a, b) => a - b : (a, b) => a.localeCompare(b, "en", { numeric: true });
  const rows = [...body.rows].sort((a, b) => {
    const [x, y] = [key(a), key(b)];
    if (x === "" || y === "") return (x === "") - (y === "");
    return up ? order(x, y) : order(y, x);
  });
  body.append(...rows);
}

/* Marks elements whose content is wider than the element: they scroll, and take the keyboard focus.
   Sizes change when details are opened. */
const scrollers = document.querySelectorAll(".scroll, figure.wide .drawing");
const sizes = new ResizeObserver((entries) => {
  for (const { target } of entries) {
    const wide = target.scrollWidth > target.clientWidth + 1;
    target.classList.toggle("wider", wide);
    target.tabIndex = wide ? 0 : -1;
    target.style.setProperty("--first-column", `${target.querySelector("th")?.offsetWidth ?? 0}px`);
  }
});
for (const scroller of scrollers) sizes.observe(scroller);

/* Opens all closed details for printing, and closes them afterwards. */
addEventListener("beforeprint", () => {
  for (const part of document.querySelectorAll("details:not([open])")) {
    part.open = true;
    addEventListener("afterprint", () => { part.open = false; }, { once: true });
  }
});
