// Runs before MathJax: a formula is as wide on every computer, whatever letters it has for the text,
// and on a phone begins at the left: centred beside its number it would leave half the width empty.
if (window.MathJax) {
  const narrow = window.matchMedia("(max-width: 600px)");
  const place = function () { return narrow.matches ? "left" : "center"; };
  window.MathJax.chtml = { matchFontHeight: false, scale: 1.17, displayAlign: place() };
  window.MathJax.startup = { pageReady: function () {
    return window.MathJax.startup.defaultPageReady().then(function () {
      document.querySelectorAll("mjx-container[display='true']").forEach(fadeWhatGoesOn);
    });
  } };
  // Formulas are laid out for the width that they meet: again when a phone is turned.
  narrow.addEventListener("change", function () {
    var formulas = window.MathJax.startup.document;
    formulas.outputJax.options.displayAlign = place();
    formulas.rerender();
  });
}
// Small repairs of the theme for readers with a keyboard or a screen reader.
function scrollBox(thing, kind, label) {
  if (thing.parentElement.classList.contains(kind)) return;
  var box = document.createElement("div");
  box.className = kind;
  box.tabIndex = 0;
  box.setAttribute("role", "region");
  box.setAttribute("aria-label", label);
  thing.parentNode.insertBefore(box, thing);
  box.appendChild(thing);
  fadeWhatGoesOn(box);
}
// What goes on beyond the right edge fades there.
function fadeWhatGoesOn(box) {
  function fade() {
    box.classList.toggle("goes-on", box.scrollWidth - box.clientWidth - box.scrollLeft > 2);
  }
  box.addEventListener("scroll", fade);
  new ResizeObserver(fade).observe(box);
}
document.addEventListener("DOMContentLoaded", function () {
  // Wide tables and code scroll inside their own box; such a box must be reachable by keyboard.
  document.querySelectorAll(".bd-article table").forEach(function (table) {
    scrollBox(table, "table-scroll", "Table, scrolls sideways");
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
    fadeWhatGoesOn(pre);
  });
  // No line begins with the stop or the comma that follows a formula.
  document.querySelectorAll(".bd-article span.math").forEach(function (formula) {
    var after = formula.nextSibling;
    var stop = after && after.nodeType === Node.TEXT_NODE && /^[.,;:!?)\]]+/.exec(after.data);
    if (!stop) return;
    after.splitText(stop[0].length);
    var both = document.createElement("span");
    // A short one keeps it on a phone, too.
    both.className = formula.textContent.length < 30 ? "formula-and-stop short" : "formula-and-stop";
    formula.before(both);
    both.append(formula, after);
  });
});
// The papers, line by line: a button a verdict; without this script all lines are shown.
document.addEventListener("DOMContentLoaded", function () {
  var counts = document.querySelector("table.paper-counts");
  if (!counts) return;
  var rows = Array.from(document.querySelectorAll("table.paper-lines tbody tr"));
  var bar = document.createElement("div");
  bar.className = "paper-filter";
  bar.setAttribute("role", "group");
  bar.setAttribute("aria-label", "Show the lines with this verdict only");
  function add(label, name, shown) {
    var button = document.createElement("button");
    button.type = "button";
    button.textContent = label;
    button.setAttribute("aria-pressed", String(!name));
    button.addEventListener("click", function () {
      rows.forEach(function (row) { row.hidden = !shown(row); });
      bar.querySelectorAll("button").forEach(function (each) {
        each.setAttribute("aria-pressed", String(each === button));
      });
    });
    bar.appendChild(button);
  }
  add("all (" + rows.length + ")", "", function () { return true; });
  counts.querySelectorAll("tbody tr").forEach(function (line) {
    var name = line.cells[0].textContent.trim();
    var kind = "verdict-" + name.replace(/ /g, "-");
    var of = rows.filter(function (row) { return row.classList.contains(kind); }).length;
    if (of) add(name + " (" + of + ")", name, function (row) { return row.classList.contains(kind); });
  });
  (counts.closest(".table-scroll") || counts).after(bar);
});

// On a phone the labels of a wide figure would shrink to specks. Panels that stand side by side with
// nothing between them are stacked; any other wide figure scrolls in a box of its own.
document.addEventListener("DOMContentLoaded", function () {
  var phone = window.matchMedia("(max-width: 600px)");
  // How the alternative text of an exercise's picture begins; the rest is the caption below it.
  var yours = "Two panels, yours and as it should be: ";
  // Of others with a caption the text, written by hand, begins likewise.
  var handwritten = /^Two (panels|maps)/;
  var ofExercises = /\/(exercises|solutions)\//.test(location.pathname);
  // Middles of the empty stripes between panels, as parts of the width: one near a half, or two
  // near the thirds; none if something crosses them. And where the panels end, as a part of the
  // height: the caption of an exercise's picture stands below both.
  function gaps(picture, captioned, known) {
    var canvas = document.createElement("canvas");
    var width = canvas.width = 600;
    var height = canvas.height = Math.round(width * picture.naturalHeight / picture.naturalWidth);
    var context = canvas.getContext("2d", { willReadFrequently: true });
    context.fillStyle = "#fff";
    context.fillRect(0, 0, width, height);
    context.drawImage(picture, 0, 0, width, height);
    var pixels = context.getImageData(0, 0, width, height).data;
    function blank(x, y) {
      var at = 4 * (y * width + x);
      return pixels[at] + pixels[at + 1] + pixels[at + 2] >= 750;
    }
    function empty(x, bottom) {
      for (var y = 0; y < bottom; y++) if (!blank(x, y)) return false;
      return true;
    }
    function written(y, from, to) {
      for (var x = from; x < to; x++) if (!blank(x, y)) return true;
      return false;
    }
    // The widest empty stripe within two parts of the width, in the rows above the bottom.
    function gap(from, to, bottom, least) {
      var best = null, start = -1;
      for (var x = Math.round(from * width); x <= to * width; x++) {
        if (!empty(x, bottom)) { start = -1; continue; }
        if (start < 0) start = x;
        if (x - start >= least && (!best || x - start > best[1] - best[0])) best = [start, x];
      }
      return best;
    }
    function middle(stripe) { return stripe && (stripe[0] + stripe[1]) / 2 / width; }
    if (captioned) {
      // A stripe is wider than the space between two words of the caption.
      var bottom = height, between, line;
      while (!(between = gap(0.35, 0.65, bottom, 12)) && bottom > 0.7 * height) bottom -= 1;
      if (!between) return { cuts: [], bottom: 1 };
      // The line of the caption that crosses the stripe begins some rows higher.
      line = bottom;
      while (bottom < height && line - bottom < 14 && written(bottom - 1, 0, width)) bottom -= 1;
      if (bottom < height) bottom -= 2;  // where its letters fade out
      // A short caption does not cross it: it stands left, below all that the right panel has.
      else if (known) {
        while (bottom > 0.7 * height && !written(bottom - 1, between[1], width)) bottom -= 1;
      }
      return { cuts: [middle(between)], bottom: bottom / height };
    }
    var thirds = [gap(0.26, 0.4, height, 4), gap(0.58, 0.74, height, 4)].map(middle);
    var half = middle(gap(0.4, 0.6, height, 4));
    if (thirds[0] && thirds[1]) return { cuts: thirds, bottom: 1 };
    return { cuts: half ? [half] : [], bottom: 1 };
  }
  function stack(whole, picture, cuts, bottom) {
    var box = document.createElement("div");
    box.className = "figure-panels";
    whole.replaceWith(box);
    box.appendChild(whole);
    var ends = [0].concat(cuts, [1]);
    // Two panels that are compared keep one scale.
    var most = Math.max.apply(null, cuts.concat([1]).map(function (end, k) { return end - ends[k]; }));
    cuts.concat([1]).forEach(function (end, k) {
      var share = end - ends[k];
      var panel = document.createElement("div");
      panel.className = "figure-panel";
      if (bottom < 1) panel.style.width = 100 * share / most + "%";
      panel.style.aspectRatio = share * picture.naturalWidth / (bottom * picture.naturalHeight);
      var part = document.createElement("img");
      part.src = picture.src;
      part.alt = k ? "" : picture.alt;
      part.style.width = 100 / share + "%";
      part.style.marginLeft = -100 * ends[k] / share + "%";
      panel.appendChild(part);
      box.appendChild(panel);
    });
    if (bottom === 1) return;
    var caption = document.createElement("p");
    caption.className = "panels-caption";
    var text = picture.alt.startsWith(yours) ? picture.alt.slice(yours.length) : picture.alt;
    caption.textContent = text[0].toUpperCase() + text.slice(1);
    box.appendChild(caption);
  }
  function place(picture) {
    var width = Number(picture.getAttribute("width")) || picture.naturalWidth;
    var whole = picture.closest("a") || picture;
    if (width < 480 || whole.parentElement.matches(".figure-panels, .figure-scroll")) return;
    var found = { cuts: [] }, known = picture.alt.startsWith(yours);
    var captioned = known || (ofExercises && handwritten.test(picture.alt));
    try {
      if (captioned || picture.naturalWidth > 1.5 * picture.naturalHeight) {
        found = gaps(picture, captioned, known);
      }
    } catch (error) { /* a page from the disk may not look into its pictures */ }
    if (found.cuts.length) stack(whole, picture, found.cuts, found.bottom);
    else scrollBox(whole, "figure-scroll", "Figure, scrolls sideways");
  }
  function placeAll() {
    if (!phone.matches) return;
    var pictures = ".bd-article .cell_output > img, .bd-article .cell_output > a > img";
    document.querySelectorAll(pictures).forEach(function (picture) {
      if (picture.complete) place(picture);
      else picture.addEventListener("load", function () { place(picture); });
    });
  }
  placeAll();
  phone.addEventListener("change", placeAll);
});

// The league: a click on the head of a column sorts by it; without this script the most accurate
// system stands first.
document.addEventListener("DOMContentLoaded", function () {
  function key(cell) {
    var text = cell.textContent.trim();
    var number = parseFloat(text);
    return { text: text, number: isNaN(number) ? (text ? null : Infinity) : number };
  }
  document.querySelectorAll(".sortable table").forEach(function (table) {
    var body = table.tBodies[0];
    Array.from(table.tHead.rows[0].cells).forEach(function (head, column) {
      var button = document.createElement("button");
      button.type = "button";
      button.className = "sort";
      while (head.firstChild) button.appendChild(head.firstChild);
      head.appendChild(button);
      button.addEventListener("click", function () {
        var down = head.getAttribute("aria-sort") === "ascending";
        Array.from(table.tHead.rows[0].cells).forEach(function (each) {
          each.removeAttribute("aria-sort");
        });
        head.setAttribute("aria-sort", down ? "descending" : "ascending");
        Array.from(body.rows).sort(function (a, b) {
          var x = key(a.cells[column]), y = key(b.cells[column]);
          var less = x.number !== null && y.number !== null
            ? x.number - y.number : x.text.localeCompare(y.text);
          return (down ? -1 : 1) * (less || 0);
        }).forEach(function (row) { body.appendChild(row); });
      });
    });
  });
});
