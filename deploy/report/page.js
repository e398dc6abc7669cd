// The replay: robots move between the frames, maps change where a snapshot was taken, the story of trust is told beside.
// Without scripts the page shows the end of the run.
const run = JSON.parse(document.getElementById("frames").textContent);
const plan = document.querySelector("svg.plan");
const element = (id) => document.getElementById(id);
const svg = (name, attributes, text = "") => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = text;
  return made;
};

for (const box of document.querySelectorAll("input[data-robot]"))
  box.addEventListener("change", () => {
    for (const part of document.querySelectorAll("svg [data-robot]"))
      if (part.dataset.robot === box.dataset.robot) part.toggleAttribute("hidden", !box.checked);
  });

for (const box of document.querySelectorAll("input[data-layer]"))
  box.addEventListener("change", () => plan.classList.toggle("no-" + box.dataset.layer, !box.checked));

const KINDS = ["walls", "heard", "nominal", "occlusion", "frontier"];
const LANES = 5, MARK_PX = 13;  // of the marks under the slider
const SAID_S = 8;  // how long an event stays on the map
const WHOLE_S = 40;  // seconds in which a run is played, but at least at real time

function replay() {
  const { times, scans, coverage, story, bonds } = run, end = times.length - 1, last = times[end];
  const slider = element("slider"), play = element("play"), names = element("names"), links = element("links");
  const unit = parseFloat(getComputedStyle(plan).getPropertyValue("--unit"));
  const rate = Math.max(1, last / WHOLE_S);
  let now = 0, running = false, before = 0;
  document.body.classList.add("moving");

  const robots = [...plan.querySelectorAll("g.robot")].map((group) => {
    const { at, maps } = run.robots[group.dataset.robot];
    const name = svg("text", { style: group.getAttribute("style"), "data-robot": group.dataset.robot }, group.dataset.robot);
    const said = svg("tspan", { class: "said" });
    name.append(said);
    if (at.length) names.append(name);
    const parts = Object.fromEntries([...KINDS, "trail", "place"].map((kind) => [kind, group.querySelector("." + kind)]));
    return { name: group.dataset.robot, at, maps, label: name, said, parts, shown: null };
  });
  const byName = new Map(robots.map((robot) => [robot.name, robot]));  // a peer may be called toString

  const frame = (t) => {  // its number, and the share of the way to the next
    let k = Math.min(Math.floor(t / Math.max(times[1] - times[0] || 1, 1e-9)), end);
    while (k > 0 && times[k] > t) k--;
    while (k < end && times[k + 1] <= t) k++;  // the last step may be shorter: a run ends where it ends
    const next = times[k + 1];
    return [k, next ? Math.min((t - times[k]) / (next - times[k]), 1) : 0];
  };
  const place = ({ at }, k, part) => {
    if (!at.length) return null;
    const n = Math.min(k + 1, at.length / 2 - 1);
    return [0, 1].map((c) => (at[2 * k + c] * (1 - part) + at[2 * n + c] * part) / 100);
  };

  const ticks = element("ticks");
  const marks = story.map(({ t, robot, event, glyph, text }) => {
    const near = byName.get(robot)?.label.getAttribute("style") ?? "";
    const mark = svg("text", { style: near, "data-robot": robot }, glyph);
    mark.append(svg("title", {}, `${t} s: ${text}`));
    mark.addEventListener("click", () => seek(t));
    return { t, mark, minor: event === "contact" };
  }).sort((a, b) => a.minor - b.minor);

  ticks.append(...marks.map(({ mark }) => mark));

  // Each mark in the uppermost lane where it hides none; contacts last. What finds no room stands in the list alone.
  function lay() {
    const lanes = Array.from({ length: LANES }, () => []);
    for (const { t, mark } of marks) {
      const x = t / last * ticks.clientWidth;
      const lane = lanes.findIndex((taken) => taken.every((other) => Math.abs(other - x) >= MARK_PX));
      mark.classList.toggle("crowded", lane < 0);
      if (lane < 0) continue;
      lanes[lane].push(x);
      mark.setAttribute("x", x);
      mark.setAttribute("y", MARK_PX * (lane + 1));
    }
    ticks.style.height = MARK_PX * lanes.filter((taken) => taken.length).length + 6 + "px";
  }
  new ResizeObserver(lay).observe(element("slider"));

  function show(t) {
    now = Math.min(Math.max(t, 0), last);
    const [k, part] = frame(now);
    const recent = story.filter((event) => event.t <= now && now < event.t + SAID_S);
    for (const robot of robots) {
      let index = robot.maps.length - 1;
      while (index >= 0 && robot.maps[index][0] > k) index--;
      if (index !== robot.shown) {
        robot.shown = index;
        KINDS.forEach((kind, i) => robot.parts[kind].setAttribute("d", index < 0 ? "" : robot.maps[index][1][i]));
      }
      const here = place(robot, k, part);
      if (!here) continue;
      const [x, y] = here;
      let trail = "";
      for (let i = 0; i <= k; i++) trail += `${i ? "L" : "M"}${robot.at[2 * i] / 100} ${robot.at[2 * i + 1] / 100}`;
      robot.parts.trail.setAttribute("d", `${trail}L${x} ${y}`);
      robot.parts.place.setAttribute("d", `M${x} ${y}h0`);
      robot.label.setAttribute("x", x + 9 * unit);
      robot.label.setAttribute("y", -y - 7 * unit);
      const own = recent.filter((event) => event.robot === robot.name).pop();
      robot.said.textContent = own ? ` ${own.glyph} ${own.peer || ""}` : "";
    }
    const lasting = bonds.filter(({ since, until }) => since <= now && now < (until ?? Infinity));
    links.replaceChildren(...lasting.flatMap(({ robot, peer, trial }) => {
      const [a, b] = [robot, peer].map((name) => byName.has(name) && place(byName.get(name), k, part));
      return a && b ? [svg("path", { d: `M${a}L${b}`, class: trial ? "trial" : "heard-by" })] : [];
    }));
    slider.value = now;
    element("time").value = scans ? `scan ${now.toFixed(0)}` : `${now.toFixed(0)} s`;
    slider.setAttribute("aria-valuetext", element("time").value);
    element("caption").textContent = Object.entries(coverage)
      .filter(([, values]) => values[k] !== null)
      .map(([name, values]) => `${name} ${(values[k] / 10).toFixed(1)} %`).join(", ");
    for (const cursor of document.querySelectorAll(".cursor")) {
      const { left, wide } = cursor.dataset;
      cursor.setAttribute("transform", `translate(${+left + wide * now / Math.max(last, 1)} 0)`);
      cursor.removeAttribute("hidden");
    }
    const list = element("story");
    if (list) {
      const rows = [...list.children];
      const row = rows.filter((item) => +item.firstElementChild.dataset.t <= now).pop();
      if (row !== list.now) {
        list.now?.classList.remove("now");
        row?.classList.add("now");
        if (row) list.scrollTop = row.offsetTop - list.offsetTop - list.clientHeight / 2;
        list.now = row;
      }
    }
  }

  function step(clock) {
    if (!running) return;
    show(now + rate * (clock - before) / 1000);
    before = clock;
    if (now >= last) stop(); else requestAnimationFrame(step);
  }
  function start() {
    if (now >= last) show(0);
    running = true;
    play.textContent = "❚❚";
    before = performance.now();
    requestAnimationFrame(step);
  }
  function stop() { running = false; play.textContent = "▶"; }
  function seek(t) { stop(); show(t); }

  slider.max = last;
  slider.addEventListener("input", () => seek(+slider.value));
  play.addEventListener("click", () => running ? stop() : start());
  for (const button of document.querySelectorAll("#story button"))
    button.addEventListener("click", () => seek(+button.dataset.t));
  document.addEventListener("keydown", (event) => {
    if (event.target.matches?.("input[type=checkbox], summary, #story button") && event.key === " ") return;
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    const far = event.shiftKey ? 10 : 1;
    const keys = {
      " ": () => running ? stop() : start(), ArrowRight: () => seek(now + far), ArrowLeft: () => seek(now - far),
      Home: () => seek(0), End: () => seek(last),
    };
    if (!(event.key in keys)) return;
    event.preventDefault();
    keys[event.key]();
  });
  addEventListener("beforeprint", () => seek(last));
  element("replay").hidden = false;
  if (matchMedia("(prefers-reduced-motion: reduce)").matches || matchMedia("print").matches) show(last);
  else { show(0); start(); }
}

if (run.times) replay();
