// The headline stands over the 3D view: what the server puts into [data-over-view] is shown in a bar of ours between the
// docks, and the 3D view begins below it. On a phone the view ends where viser's sheet begins.
"use strict";

(() => {
  const bar = document.createElement("section");
  bar.id = "inspector-bar";
  bar.setAttribute("aria-label", "How far the arm is off, and what comes next");
  document.body.append(bar);
  const root = document.documentElement;

  // A copy: the original belongs to viser's panel, which may be folded away.
  function show() {
    const source = document.querySelector("[data-over-view]");
    if (source && source.innerHTML !== bar.dataset.shown) {
      bar.dataset.shown = source.innerHTML;
      const focused = [...bar.querySelectorAll("[tabindex]")].indexOf(document.activeElement);
      bar.innerHTML = source.innerHTML;
      if (focused >= 0) bar.querySelectorAll("[tabindex]")[focused]?.focus();
    }
    place();
  }

  function set(name, pixels) {
    const value = `${Math.round(pixels)}px`;
    if (root.style.getPropertyValue(name) !== value) root.style.setProperty(name, value);
  }

  function place() {
    const view = document.querySelector("canvas")?.parentElement;
    if (!view) return;
    if (!view.hasAttribute("data-inspector-view")) {
      view.setAttribute("data-inspector-view", "");
      resized.observe(view);
    }
    const box = view.getBoundingClientRect();
    set("--inspector-left", box.left);
    set("--inspector-width", box.width);
    set("--inspector-bar", bar.getBoundingClientRect().height);
    const sheet = document.querySelector('div[style*="position: fixed"][style*="width: 20em"]');
    if (sheet && !sheet.hasAttribute("data-inspector-sheet")) {
      sheet.setAttribute("data-inspector-sheet", "");
      resized.observe(sheet);
    }
    set("--inspector-sheet", sheet ? window.innerHeight - sheet.getBoundingClientRect().top : 0);
  }

  const resized = new ResizeObserver(place);
  resized.observe(bar);
  window.addEventListener("resize", place);
  new MutationObserver(show).observe(document.body, { subtree: true, childList: true, characterData: true });
  show();
})();
