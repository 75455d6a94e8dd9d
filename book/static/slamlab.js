// Small repairs of the theme for readers with a keyboard or a screen reader.
document.addEventListener("DOMContentLoaded", function () {
  // Wide tables and code scroll inside their own box; such a box must be reachable by keyboard.
  document.querySelectorAll(".bd-article table").forEach(function (table) {
    if (table.parentElement.classList.contains("table-scroll")) return;
    var box = document.createElement("div");
    box.className = "table-scroll";
    box.tabIndex = 0;
    box.setAttribute("role", "region");
    box.setAttribute("aria-label", "Table, scrolls sideways");
    table.parentNode.insertBefore(box, table);
    box.appendChild(table);
  });
  // The bibliography calls itself a list, but its entries are no list items.
  document.querySelectorAll(".citation-list").forEach(function (list) {
    list.removeAttribute("role");
  });
  // The sidebar's arrows open a chapter's exercises; the theme gives them no name.
  document.querySelectorAll("nav summary").forEach(function (summary) {
    var link = summary.parentElement.parentElement.querySelector("a");
    if (link) summary.setAttribute("aria-label", "Sections of " + link.textContent.trim());
  });
  document.querySelectorAll(".bd-article pre").forEach(function (pre) {
    pre.tabIndex = 0;
  });
});
