// The slider over the snapshots, and the switches. Without scripts the page shows the end of the run.
const run = JSON.parse(document.getElementById("frames").textContent);
const plan = document.querySelector("svg.plan");
const kinds = ["walls", "nominal", "occlusion", "frontier"];

for (const box of document.querySelectorAll("input[data-robot]"))
  box.addEventListener("change", () => {
    for (const part of plan.querySelectorAll("[data-robot]"))
      if (part.dataset.robot === box.dataset.robot) part.toggleAttribute("hidden", !box.checked);
  });

for (const box of document.querySelectorAll("input[data-layer]"))
  box.addEventListener("change", () => plan.classList.toggle("no-" + box.dataset.layer, !box.checked));

function show(k) {
  for (const group of plan.querySelectorAll("g.robot")) {
    const { maps, trails, places } = run.robots[group.dataset.robot];
    let last = k;
    while (last > 0 && maps[last] === 0) last--;
    kinds.forEach((kind, i) => group.querySelector("." + kind).setAttribute("d", maps[last] ? maps[last][i] : ""));
    group.querySelector(".trail").setAttribute("d", trails.slice(0, k + 1).join(""));
    group.querySelector(".place").setAttribute("d", places[k]);
  }
  document.getElementById("time").value = `${run.times[k].toFixed(0)} s`;
  document.getElementById("caption").textContent = run.captions[k];
}

if (run.times) {
  const slider = document.getElementById("slider");
  const play = document.getElementById("play");
  let timer = null;
  const stop = () => { clearInterval(timer); timer = null; play.textContent = "▶"; };
  slider.max = run.times.length - 1;
  slider.value = slider.max;
  slider.addEventListener("input", () => { stop(); show(+slider.value); });
  play.addEventListener("click", () => {
    if (timer) return stop();
    if (slider.value === slider.max) slider.value = 0;
    play.textContent = "❚❚";
    timer = setInterval(() => {
      show(+slider.value);
      if (slider.value === slider.max) stop(); else slider.value++;
    }, 120);
  });
  document.getElementById("replay").hidden = false;
  show(+slider.value);
}
