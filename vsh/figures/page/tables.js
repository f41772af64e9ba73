"use strict";
// Tables that sort: by the number in a cell, or by its words where there is none.
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = Array.from(table.tHead.rows[0].cells), body = table.tBodies[0];
  const value = (row, column) => {
    const text = row.cells[column].textContent.trim(), number = parseFloat(text.replace(/^[<>]\s*/, "").replace("−", "-"));
    return /^[<>+−-]?\s*[.\d]/.test(text) && !Number.isNaN(number) ? number : text;
  };
  const compare = (a, b) => typeof a === typeof b ? (a < b ? -1 : a > b ? 1 : 0) : typeof a === "number" ? -1 : 1;
  heads.forEach((head, column) => {
    const button = head.querySelector("button");
    if (!button) return;
    button.addEventListener("click", () => {
      const rising = head.getAttribute("aria-sort") !== "ascending";
      const rows = Array.from(body.rows).map((row) => [value(row, column), row]);
      rows.sort((a, b) => (rising ? 1 : -1) * compare(a[0], b[0]));
      body.append(...rows.map((each) => each[1]));
      for (const other of heads) if (other.hasAttribute("aria-sort")) other.setAttribute("aria-sort", "none");
      head.setAttribute("aria-sort", rising ? "ascending" : "descending");
    });
  });
  // The rows as they stand, for a spreadsheet.
  const save = Object.assign(document.createElement("a"), { className: "save", href: "#", textContent: "save as CSV" });
  save.addEventListener("click", (event) => {
    event.preventDefault();
    const cell = (each) => `"${each.textContent.trim().replace("−", "-").replaceAll('"', '""')}"`;
    const text = Array.from(table.rows, (row) => Array.from(row.cells, cell).join(",")).join("\r\n");
    const url = URL.createObjectURL(new Blob([`\ufeff${text}\r\n`], { type: "text/csv" }));
    const title = table.closest(".wide").getAttribute("aria-label").replace(/\W+/g, "_").toLowerCase();
    Object.assign(document.createElement("a"), { href: url, download: `${title}.csv` }).click();
    URL.revokeObjectURL(url);
  });
  table.closest(".wide").after(save);
}
