// Tells require.js where anywidget lies: beside this file, so that no page asks the network.
(function () {
  var here = document.currentScript.src.split("?")[0].replace(/[^/]*$/, "");
  window.FontAwesomeConfig = { autoReplaceSvg: "nest" };
  requirejs.config({ paths: { anywidget: here + "vendor/anywidget/index" } });
})();
