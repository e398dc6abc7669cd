// Start Rerun's viewer (re_viewer.js) on the recording beside this page.
"use strict";

const words = document.getElementById("words");
const canvas = document.getElementById("view");

async function start() {
  await wasm_bindgen({ module_or_path: "re_viewer_bg.wasm" });
  const viewer = new wasm_bindgen.WebHandle({
    theme: "light", // robots' colours are for a white ground
    url: [new URL("run.rrd", location).href],
    hide_welcome_screen: true,
    enable_history: false,
    persist: false, // the layout is the recording's, not that of a run seen before
  });
  await viewer.start(canvas);
  words.textContent = "";
  canvas.classList.add("ready");
  setInterval(() => {
    if (viewer.has_panicked()) fail(viewer.panic_message());
  }, 1000);
}

function fail(reason) {
  canvas.classList.remove("ready");
  words.textContent = `The viewer does not run in this browser: ${reason}`;
}

start().catch(fail);
