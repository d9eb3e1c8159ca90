// Files dropped anywhere on the page, and several chosen in the file dialog, become one zip (stored, not deflated) for
// the upload button, which sends one file. Where the server takes no data there is no such button, and nothing happens.
"use strict";

(() => {
  const MOST_BYTES = 500e6; // as inspector/server/uploads.py takes
  const MOST_FILES = 5000;
  const input = () => document.querySelector('input[type="file"][id^="file_upload_"]');

  // ---- a zip of files as they are ----

  const table = Uint32Array.from({ length: 256 }, (_, n) => {
    for (let k = 0; k < 8; k++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
    return n >>> 0;
  });

  function crc32(bytes) {
    let crc = 0xffffffff;
    for (const byte of bytes) crc = table[(crc ^ byte) & 255] ^ (crc >>> 8);
    return (crc ^ 0xffffffff) >>> 0;
  }

  // Fields of 2 or 4 bytes, little-endian.
  function record(...fields) {
    const out = new DataView(new ArrayBuffer(fields.reduce((sum, [size]) => sum + size, 0)));
    let at = 0;
    for (const [size, value] of fields) {
      if (size === 2) out.setUint16(at, value, true);
      else out.setUint32(at, value, true);
      at += size;
    }
    return new Uint8Array(out.buffer);
  }

  async function zipOf(files) {
    const parts = [];
    const entries = [];
    let offset = 0;
    for (const { path, file } of files) {
      const name = new TextEncoder().encode(path);
      const content = new Uint8Array(await file.arrayBuffer());
      const common = [
        [2, 20], [2, 0x0800], [2, 0], [2, 0], [2, 0x21], // version, names in UTF-8, stored, 1980-01-01
        [4, crc32(content)], [4, content.length], [4, content.length], [2, name.length], [2, 0],
      ];
      const head = record([4, 0x04034b50], ...common);
      parts.push(head, name, content);
      entries.push(record([4, 0x02014b50], [2, 20], ...common, [2, 0], [2, 0], [2, 0], [4, 0], [4, offset]), name);
      offset += head.length + name.length + content.length;
    }
    const size = entries.reduce((sum, each) => sum + each.length, 0);
    const count = files.length;
    const end = record([4, 0x06054b50], [2, 0], [2, 0], [2, count], [2, count], [4, size], [4, offset], [2, 0]);
    return new File([...parts, ...entries, end], archiveName(files), { type: "application/zip" });
  }

  // Called as the folder that was dropped, or as the first table.
  function archiveName(files) {
    const folder = files[0].path.includes("/") ? files[0].path.split("/")[0] : "";
    const tables = files.filter(({ path }) => /\.(csv|tsv|txt|dat)$/i.test(path));
    return (folder || (tables[0] ?? files[0]).file.name.replace(/\.[^.]*$/, "")) + ".zip";
  }

  // ---- what was dropped: files, and all that is in folders ----

  async function filesOf(entry, path = "") {
    if (entry.isFile) {
      const file = await new Promise((done, failed) => entry.file(done, failed));
      return [{ path: path + entry.name, file }];
    }
    const out = [];
    const reader = entry.createReader();
    for (;;) {
      const some = await new Promise((done, failed) => reader.readEntries(done, failed));
      if (!some.length || out.length > MOST_FILES) return out;
      for (const each of some) if (!each.name.startsWith(".")) out.push(...(await filesOf(each, `${path}${entry.name}/`)));
    }
  }

  async function dropped(transfer) {
    // Before the first await: the list is emptied when the event has passed.
    const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
    const plain = [...transfer.files].map((file) => ({ path: file.name, file }));
    if (!entries.length) return plain;
    return (await Promise.all(entries.map((entry) => filesOf(entry)))).flat();
  }

  // ---- to the button ----

  async function send(files) {
    const target = input();
    if (!target || !files.length) return;
    const bytes = files.reduce((sum, { file }) => sum + file.size, 0);
    if (files.length > MOST_FILES || bytes > MOST_BYTES) {
      say(`These are ${files.length} files of ${Math.ceil(bytes / 1e6)} MB; at most ${MOST_FILES} files of ${MOST_BYTES / 1e6} MB are taken.`);
      return;
    }
    try {
      const one = files.length === 1 && !files[0].path.includes("/") ? files[0].file : await zipOf(files);
      const transfer = new DataTransfer();
      transfer.items.add(one);
      target.files = transfer.files;
      target.dispatchEvent(new CustomEvent("change", { bubbles: true, detail: "packed" }));
    } catch (error) {
      say(`The files cannot be read (${error.message ?? error}).`);
    }
  }

  document.addEventListener(
    "change",
    (event) => {
      if (event.target !== input() || event.detail === "packed") return;
      const files = [...event.target.files].map((file) => ({ path: file.name, file }));
      const bytes = files.reduce((sum, { file }) => sum + file.size, 0);
      if (files.length < 2 && bytes <= MOST_BYTES) return; // the button's own way
      event.stopPropagation();
      send(files);
    },
    { capture: true },
  );

  // Viser's dialog offers one file; ours several.
  document.addEventListener(
    "click",
    (event) => {
      if (event.target === input()) event.target.multiple = true;
    },
    { capture: true },
  );

  // ---- the zone over the whole page ----

  const zone = document.createElement("div");
  zone.id = "inspector-drop";
  zone.style.cssText =
    "position:fixed;inset:12px;z-index:10000;display:none;align-items:center;justify-content:center;text-align:center;" +
    "border:3px dashed #56B4E9;border-radius:12px;background:rgba(20,30,40,0.82);color:#fff;font:600 20px system-ui,sans-serif;" +
    "pointer-events:none;padding:24px";

  function show(words) {
    zone.textContent = words;
    zone.style.display = "flex";
    if (!zone.isConnected) document.body.append(zone);
  }

  const hide = () => (zone.style.display = "none");

  function say(words) {
    show(words);
    setTimeout(hide, 6000);
  }

  const hasFiles = (event) => [...(event.dataTransfer?.types ?? [])].includes("Files");
  let over = 0; // elements entered and not left

  document.addEventListener("dragenter", (event) => {
    if (!hasFiles(event)) return;
    over += 1;
    show(
      input()
        ? "Drop your data: a zip, a folder, a robot's file with CSV tables of joints and points, or a session"
        : "Files go in by “Open your own data …” in the panel Review: open it; the button takes them or says what is missing",
    );
  });
  document.addEventListener("dragleave", (event) => {
    if (!hasFiles(event)) return;
    over = Math.max(0, over - 1);
    if (!over) hide();
  });
  document.addEventListener("dragover", (event) => {
    if (hasFiles(event)) event.preventDefault(); // else the browser would open the file in place of the page
  });
  document.addEventListener("drop", async (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault();
    over = 0;
    hide();
    send(await dropped(event.dataTransfer));
  });
})();
