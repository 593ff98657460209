
// A click or Enter on a column's head sorts by it, once more the other way; numbers by their size.
const size = text => parseFloat(text.replace(/\u2212/g, "-").replace(/,(?=\d{3})/g, ""));
const order = (a, b) => {
  const x = size(a), y = size(b);
  return isNaN(x) || isNaN(y) ? isNaN(x) - isNaN(y) || a.localeCompare(b) : x - y;
};
const sort = head => {
  const up = head.getAttribute("aria-sort") !== "ascending";
  const column = head.cellIndex, body = head.closest("table").tBodies[0];
  const text = row => row.cells[column] ? row.cells[column].textContent.trim() : "";
  const rows = [...body.rows].sort((a, b) => order(text(a), text(b)) * (up ? 1 : -1));
  for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", up ? "ascending" : "descending");
  body.append(...rows);
};
for (const head of document.querySelectorAll("thead th")) {
  head.tabIndex = 0;
  head.addEventListener("click", () => sort(head));
  head.addEventListener("keydown", key => { if (key.key === "Enter") sort(head); });
}
// Commands have a button that copies them, where the browser lets a page do so.
for (const code of navigator.clipboard ? document.querySelectorAll(".next pre code") : []) {
  const button = document.createElement("button");
  button.textContent = "Copy";
  button.addEventListener("click", () => {
    navigator.clipboard.writeText(code.textContent).then(
      () => { button.textContent = "Copied"; },
      () => { getSelection().selectAllChildren(code); button.textContent = "Ctrl-C"; });
  });
  code.closest(".next").append(button);
}
