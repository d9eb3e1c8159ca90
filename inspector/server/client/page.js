// Served with the page by inspector/server/page_requests.py. Plots, table rows and words in sentences send no events to
// Python through viser: here a click on one becomes a request of the page, as a widget's would be.
"use strict";

const inspector = (() => {
  let last = Promise.resolve();

  // One request after the other, so that the last click is the last one answered.
  function ask(name, value) {
    const query = new URLSearchParams({ name, value: String(value) });
    last = last
      .then(() => fetch(`inspector/ask?${query}`, { headers: { "X-Inspector": "1" }, cache: "no-store" }))
      .catch(() => undefined); // the server is gone: the page says so itself
    return last;
  }

  // ---- tabs: "Learn/What is missing" opens a step's tab and then the tab inside it ----

  const tabsOnShow = () =>
    [...document.querySelectorAll('[role="tab"]')].filter((tab) => tab.getClientRects().length > 0);
  const labelOf = (tab) => tab.textContent.trim();

  async function openTab(path) {
    for (const label of path.split("/")) {
      const tab = await appearing(() => tabsOnShow().find((each) => labelOf(each) === label));
      if (!tab) return;
      if (tab.getAttribute("aria-selected") === "true") continue;
      if (tab.hasAttribute("data-dock-tab"))
        tab.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
      else tab.click();
    }
  }

  async function appearing(find, longest_ms = 2000) {
    const until = performance.now() + longest_ms;
    for (;;) {
      const found = find();
      if (found || performance.now() > until) return found;
      await new Promise((next) => requestAnimationFrame(next));
    }
  }

  // The tabs on show, told when the user has changed them (not when the page lays itself out).
  let gesture = -Infinity;
  let told = "";
  for (const kind of ["pointerdown", "keydown"])
    document.addEventListener(kind, () => (gesture = performance.now()), { capture: true, passive: true });

  // A page that becomes a phone's, or a desk's again, is laid out anew by viser, on the first tabs: the last ones return.
  let kept = "";
  let laidOut = -Infinity;
  window.matchMedia("(max-width: 36em)").addEventListener("change", () => {
    laidOut = performance.now();
    setTimeout(openTab, 500, kept);
  });

  function tellTabs() {
    const names = tabsOnShow()
      .filter((tab) => tab.getAttribute("aria-selected") === "true")
      .map(labelOf)
      .join("/");
    if (names === told) return;
    told = names;
    if (performance.now() - laidOut > 3000) kept = names.replace("Review/", ""); // a phone has none beside the others
    if (performance.now() - gesture < 3000) ask("tabs", names);
  }

  // ---- what can be clicked: data-ask names the request, data-value what it is about, data-tab a tab to open ----

  function follow(element) {
    if (element.dataset.tab) openTab(element.dataset.tab);
    if (element.dataset.ask) ask(element.dataset.ask, element.dataset.value ?? "");
  }

  const askable = (event) =>
    event.target instanceof Element ? event.target.closest("[data-ask], [data-tab]") : null;

  document.addEventListener("click", (event) => {
    const element = askable(event);
    const choosing = String(window.getSelection() ?? "") !== ""; // marking text to copy it is no click
    if (element && !choosing && element.getAttribute("aria-disabled") !== "true") follow(element);
  });
  document.addEventListener("keydown", (event) => {
    const element = askable(event);
    if (element && element === document.activeElement && (event.key === "Enter" || event.key === " ")) {
      event.preventDefault();
      follow(element);
    }
  });

  let waiting = false;
  function look() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      tellTabs();
    });
  }
  new MutationObserver(look).observe(document.documentElement, {
    subtree: true,
    childList: true,
    attributes: true,
    attributeFilter: ["aria-selected", "class"],
  });

  // What is chosen beside the pose is let go by Escape, where Escape does nothing else.
  document.addEventListener("keydown", (event) => {
    const typing = event.target instanceof Element && event.target.closest("input, textarea, select");
    const open = [...document.querySelectorAll('[role="dialog"], [role="listbox"]')];
    const onTop = open.some((each) => each.getClientRects().length > 0);
    if (event.key === "Escape" && !typing && !onTop) ask("joint", "");
  });

  const touched = () => gesture > -Infinity;

  return { ask, openTab, touched };
})();
