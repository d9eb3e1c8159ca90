// Ctrl+Z and Ctrl+Y reach viser's commands also where a list, a tick or a slider was used last: viser takes no key from
// an input, and the focus stays in one. A field that text is typed into keeps both keys for its own text.
"use strict";

(() => {
  const KEYS = new Set(["z", "y"]);
  const TYPED = new Set(["text", "number", "search", "email", "url", "tel", "password", ""]);

  function takesText(element) {
    if (element.tagName === "TEXTAREA" || element.isContentEditable) return true;
    if (element.tagName !== "INPUT") return false;
    if (element.getAttribute("aria-haspopup") === "listbox" || element.readOnly) return false; // a dropdown
    return TYPED.has((element.getAttribute("type") || "").toLowerCase());
  }

  document.addEventListener(
    "keydown",
    (event) => {
      if (!(event.ctrlKey || event.metaKey) || event.altKey || !KEYS.has(event.key.toLowerCase())) return;
      const focused = document.activeElement;
      if (!event.isTrusted || !focused || focused.tagName !== "INPUT" || takesText(focused)) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      focused.blur();
      const { key, code, ctrlKey, metaKey, shiftKey } = event;
      document.body.dispatchEvent(
        new KeyboardEvent("keydown", { key, code, ctrlKey, metaKey, shiftKey, bubbles: true, cancelable: true }),
      );
    },
    { capture: true },
  );
})();
