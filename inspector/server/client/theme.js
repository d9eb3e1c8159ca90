// Dark or light belongs to this page alone, the server knows nothing of it: it is as the browser prefers, or as chosen
// here by the key D, the button or the command, which this browser keeps. `?darkMode` in the address begins dark.
"use strict";

(() => {
  const KEPT = "inspector-theme";
  const LABEL = "Dark or light"; // of the button and of the command in viser's palette
  const root = document.documentElement;
  const preferred = window.matchMedia("(prefers-color-scheme: dark)");
  let chosen = new URLSearchParams(window.location.search).has("darkMode") ? "dark" : kept();

  function kept() {
    try {
      const theme = window.localStorage.getItem(KEPT);
      return theme === "dark" || theme === "light" ? theme : null;
    } catch {
      return null; // a browser may allow no storage
    }
  }

  function keep() {
    try {
      window.localStorage.setItem(KEPT, chosen);
    } catch {
      // then it is kept as long as the page is open
    }
  }

  const theme = () => chosen ?? (preferred.matches ? "dark" : "light");

  // Viser writes its own theme here when it starts; all its colours but those of the 3D view follow this attribute.
  function apply() {
    if (root.dataset.mantineColorScheme !== theme()) root.dataset.mantineColorScheme = theme();
    window.__viserMutable?.requestRender?.();
  }

  function turn() {
    chosen = theme() === "dark" ? "light" : "dark";
    keep();
    apply();
  }

  new MutationObserver(apply).observe(root, { attributes: true, attributeFilter: ["data-mantine-color-scheme"] });
  preferred.addEventListener("change", apply);
  apply();

  // Before viser, whose camera D would move to the right.
  window.addEventListener(
    "keydown",
    (event) => {
      const { key, ctrlKey, metaKey, altKey, shiftKey, repeat, target } = event;
      const typing = target instanceof Element && target.closest("input, textarea, select, [contenteditable]");
      if (key.toLowerCase() !== "d" || ctrlKey || metaKey || altKey || shiftKey || typing) return;
      event.stopImmediatePropagation();
      if (!repeat) turn();
    },
    { capture: true },
  );
  document.addEventListener("click", (event) => {
    const button = event.target instanceof Element && event.target.closest("button");
    if (button && button.textContent.trim().startsWith(LABEL)) turn();
  });

  // ---- labels in the 3D view: viser draws black on white, by shaders that name both colours ----

  const WHITE = "vec4(1.0, 1.0, 1.0,";
  const BLACK = "vec4(0.0, 0.0, 0.0,";
  const PAPER = "vec4(0.141, 0.141, 0.141,"; // of viser's panels in the dark
  const INK = "vec4(0.9, 0.9, 0.9,";
  let labels; // viser's group of meshes of all labels

  function colourLabels() {
    for (const { material } of labels.children) {
      if (material.userData.theme === theme()) continue;
      material.userData.viser ??= material.fragmentShader;
      const shader = material.userData.viser;
      material.fragmentShader = theme() === "dark" ? shader.replace(WHITE, PAPER).replace(BLACK, INK) : shader;
      material.userData.theme = theme();
      material.needsUpdate = true;
    }
  }

  function findLabels() {
    const scene = window.__viserMutable?.scene;
    scene?.traverse((node) => {
      if (node.material?.uniforms?.uLabelData) labels = node.parent;
    });
    if (!labels) return setTimeout(findLabels, 200);
    scene.onBeforeRender = colourLabels; // meshes are added as labels of other sizes come
    return apply();
  }
  findLabels();
})();
