// Plots: a click on a point, a curve or a cell asks for what it is about.
"use strict";

(() => {
  // A trace's meta names the request; its value is meta.value for the whole trace, meta.rows by the label of a heatmap's
  // row, meta.values by point, or else the point's id. Names in figures are escaped, wherever Plotly may show them.
  function valueOf(point) {
    const { value, rows, values } = point.data.meta;
    const found = rows ? rows[point.y] : (value ?? (values ? values[point.pointNumber] : point.id));
    return typeof found === "string" ? unescaped(found) : found;
  }

  function unescaped(text) {
    const area = document.createElement("textarea"); // its content is text, whatever it holds
    area.innerHTML = text;
    return area.value;
  }

  function listenTo(plot) {
    if (plot.dataset.listens || typeof plot.on !== "function") return;
    plot.dataset.listens = "true";
    plot.on("plotly_click", (event) => {
      const point = event.points.find((each) => each.data.meta?.ask && valueOf(each) !== undefined);
      if (point) inspector.ask(point.data.meta.ask, valueOf(point));
    });
    plot.on("plotly_clickannotation", (event) => inspector.ask("joint", event.annotation.name));
  }

  // A plot is taken up as the pointer comes to it: viser makes plots whenever a tab is opened.
  for (const kind of ["pointerover", "pointerdown"])
    document.addEventListener(
      kind,
      (event) => {
        const plot = event.target instanceof Element ? event.target.closest(".js-plotly-plot") : null;
        if (plot) listenTo(plot);
      },
      { capture: true, passive: true },
    );
})();
