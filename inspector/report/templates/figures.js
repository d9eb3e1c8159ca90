// Figures are kept in both versions; plotly does not follow the page. On paper they are light and as wide as the text.
"use strict";
const figures = JSON.parse(document.getElementById("figures").textContent);
const night = window.matchMedia("(prefers-color-scheme: dark)");
const PAPER_PX = 680;
function draw(dark, paper) {
  for (const figure of figures) {
    const drawn = dark ? figure.dark : figure.light;
    const layout = Object.assign({}, drawn.layout, { height: figure.height });
    if (paper) layout.width = Math.min(PAPER_PX, figure.width); else layout.autosize = true;
    Plotly.react(figure.id, drawn.data, layout, { displayModeBar: false, responsive: !paper });
  }
}
draw(night.matches, false);
night.addEventListener("change", () => draw(night.matches, false));
window.addEventListener("beforeprint", () => draw(false, true));
window.addEventListener("afterprint", () => draw(night.matches, false));
