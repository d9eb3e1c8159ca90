// Plots: a click on a point, a curve or a cell asks for what it is about; drag zooms, Shift and drag pans, Ctrl and the
// wheel zooms, a double-click goes back; small buttons save the figure.
"use strict";

(() => {
  // ---- drawing ----

  // Plotly draws in steps that wait for each other, and the last reads what Plotly.purge has thrown away by then: a tab
  // that is left, or a page that is resized, while its figure is drawn would end in an error ("Cannot read properties
  // of undefined (reading '_redrawFromAutoMarginCount')"). So a figure is thrown away once it is drawn. Viser brings
  // Plotly with the first figure, after this script.
  function drawnBeforePurged(plotly) {
    const { react, purge } = plotly;
    const drawing = new WeakMap(); // by element, how many drawings of it go on, and whether it is to be thrown away
    plotly.react = (plot, ...figure) => {
      const state = drawing.get(plot) ?? { going: 0, left: false };
      drawing.set(plot, state);
      state.going += 1;
      const ended = () => {
        state.going -= 1;
        if (state.going > 0) return;
        drawing.delete(plot);
        if (state.left) purge(plot);
      };
      let drawn;
      try {
        drawn = Promise.resolve(react(plot, ...figure));
      } catch (error) {
        ended();
        throw error;
      }
      drawn.then(ended, ended);
      return drawn;
    };
    plotly.purge = (plot) => {
      const state = drawing.get(plot);
      if (!state) return purge(plot);
      state.left = true;
      return plot;
    };
    return plotly;
  }

  let plotly;
  Object.defineProperty(window, "Plotly", {
    configurable: true,
    get: () => plotly,
    set: (brought) => (plotly = brought && drawnBeforePurged(brought)),
  });

  // ---- clicks ----

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
    plot.on("plotly_afterplot", () => tidy(plot));
    tidy(plot);
    addButtons(plot);
  }

  // ---- axes ----

  // What marks values beyond the axis says so only while they are; and the range that a double-click goes back to is
  // that of the numbers on show, not of those that were plotted here before.
  function tidy(plot) {
    const { xaxis, yaxis } = plot._fullLayout ?? {};
    if (!xaxis || !yaxis) return;
    if (plot.dataset.plotted !== undefined && plot.dataset.plotted !== yaxis.uirevision)
      for (const axis of Object.values(plot._fullLayout).filter((each) => each?._rangeInitial0 !== undefined)) {
        [axis._rangeInitial0, axis._rangeInitial1] = axis.autorange === true ? [] : axis.range;
      }
    plot.dataset.plotted = yaxis.uirevision;
    const words = plot._fullLayout.annotations?.findIndex((each) => each.name === "beyond") ?? -1;
    if (words < 0) return;
    const hidden = yaxis.autorange === true ? "none" : "";
    plot.querySelector(`.annotation[data-index="${words}"]`).style.display = hidden;
    for (const trace of plot.querySelectorAll(".scatterlayer .trace"))
      if (trace.__data__?.[0]?.trace?.meta?.beyond) trace.style.display = hidden;
  }

  // The wheel scrolls the panel, as everywhere, and zooms with Ctrl or in the enlarged figure; a finger scrolls, too.
  const inPanel = (target) =>
    target instanceof Element && target.closest(".js-plotly-plot") && !target.closest('[role="dialog"]');
  document.addEventListener(
    "wheel",
    (event) => {
      if (!event.ctrlKey && inPanel(event.target)) event.stopPropagation();
    },
    { capture: true, passive: true },
  );
  document.addEventListener(
    "touchstart",
    (event) => {
      if (event.touches.length === 1 && inPanel(event.target)) event.stopPropagation();
    },
    { capture: true, passive: true },
  );

  // ---- files ----

  function save(plot, format) {
    const figure = JSON.parse(JSON.stringify({ data: plot.data, layout: plot.layout }));
    Object.assign(figure.layout, { paper_bgcolor: "#fff", plot_bgcolor: "#fff" });
    const dataset = document.querySelector("[data-dataset]")?.dataset.dataset ?? "";
    const filename = `${dataset} ${plot._context.toImageButtonOptions.filename}`.trim().replace(/[^\p{L}\p{N}]+/gu, "_");
    const { width, height } = plot._fullLayout;
    Plotly.downloadImage(figure, { format, filename, width, height, scale: format === "png" ? 3 : 1 });
  }

  function addButtons(plot) {
    const frame = plot.parentElement;
    if (frame.querySelector(":scope > .figure-files")) return;
    const files = document.createElement("div");
    files.className = "figure-files";
    for (const format of ["png", "svg"]) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = format.toUpperCase();
      button.title = `Save this figure as ${format.toUpperCase()}`;
      button.addEventListener("click", () => save(plot, format));
      files.append(button);
    }
    frame.append(files);
  }

  // A plot is taken up as the pointer comes to it, at the latest: viser makes plots whenever a tab is opened.
  const plotAt = (target) => (target instanceof Element ? target.closest(".js-plotly-plot") : null);
  for (const kind of ["pointerover", "pointerdown"])
    document.addEventListener(kind, (event) => plotAt(event.target) && listenTo(plotAt(event.target)), {
      capture: true,
      passive: true,
    });
  let waiting = false;
  new MutationObserver(() => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      document.querySelectorAll(".js-plotly-plot").forEach(listenTo);
    });
  }).observe(document.documentElement, { subtree: true, attributes: true, attributeFilter: ["class"] });
})();
