// What stands over the 3D view: the server's [data-over-view="headline"] is shown in a bar of ours between the docks, and
// the 3D view begins below it; [data-over-view="looks"] and "legend" in the view's corners. On a phone the view ends where
// viser's sheet begins.
"use strict";

(() => {
  const root = document.documentElement;
  const shown = new Map(); // what each of ours was copied from
  const bar = added("headline", "How far the arm is off, and what comes next");
  const looks = added("looks", "Where the view is looked at from");
  const legend = added("legend", "What the colours of the 3D view mean");
  let opened; // the tab of the step that comes next, which was opened last

  function added(name, label) {
    const element = document.createElement("section");
    element.id = `inspector-${name}`;
    element.dataset.of = name;
    element.setAttribute("aria-label", label);
    document.body.append(element);
    return element;
  }

  // A copy: the original belongs to viser's panel, which may be folded away.
  function copy(element) {
    const source = document.querySelector(`[data-over-view="${element.dataset.of}"]`);
    if (!source || source.innerHTML === shown.get(element)) return;
    shown.set(element, source.innerHTML);
    const focused = [...element.querySelectorAll("[tabindex]")].indexOf(document.activeElement);
    element.innerHTML = source.innerHTML;
    if (focused >= 0) element.querySelectorAll("[tabindex]")[focused]?.focus();
  }

  let waiting = false;
  function show() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      copy(bar);
      copy(looks);
      copy(legend);
      labelTabs();
      openNextStep();
      place();
    });
  }

  // By their labels page.css hides the tabs about scans where there are none.
  function labelTabs() {
    for (const tab of document.querySelectorAll('[role="tab"]:not([data-label])'))
      tab.dataset.label = tab.textContent.trim();
  }

  // The tab of the step that comes next is open, until the user has touched the page; up to the verdict of an import.
  function openNextStep() {
    const next = bar.querySelector('.headline-step[data-state="next"]')?.dataset.tab;
    if (next === opened) return;
    opened = next;
    if (!next || (inspector.touched() && !bar.querySelector("[data-leads]"))) return;
    inspector.openTab(next);
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
