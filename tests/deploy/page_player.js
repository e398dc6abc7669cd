// Plays the replay of a page in a stand-in for a browser: node page_player.js SCRIPT FRAMES TIME...
// FRAMES is what the page embeds. Says for each TIME what the slider says then, and the robots' links as [class, path].
const { readFileSync } = require("fs");
const [script, frames, ...times] = process.argv.slice(2);

class Element {
  dataset = {}; style = {}; classList = { add() {}, remove() {}, toggle() {} };
  attributes = {}; children = []; listeners = {}; textContent = ""; clientWidth = 500;
  setAttribute(name, value) { this.attributes[name] = `${value}`; }
  getAttribute(name) { return this.attributes[name] ?? null; }
  removeAttribute(name) { delete this.attributes[name]; }
  append(...more) { this.children.push(...more); }
  replaceChildren(...more) { this.children = more; }
  addEventListener(name, call) { this.listeners[name] = call; }
  querySelector() { return new Element(); }
  querySelectorAll() { return groups; }
}
const run = JSON.parse(readFileSync(frames, "utf8")), made = {};
const groups = Object.keys(run.robots).map((robot) => Object.assign(new Element(), { dataset: { robot } }));
const element = (id) => id === "story" ? null : (made[id] ??= new Element());
element("frames").textContent = JSON.stringify(run);
global.document = {
  body: new Element(), getElementById: element, createElementNS: () => new Element(), querySelector: () => new Element(),
  querySelectorAll: () => [], addEventListener() {},
};
global.getComputedStyle = () => ({ getPropertyValue: () => "0.02" });
global.ResizeObserver = class { constructor(call) { call(); } observe() {} };
global.matchMedia = () => ({ matches: true });  // reduced motion: the end is shown at once
global.addEventListener = () => {};
(0, eval)(readFileSync(script, "utf8"));
console.log(JSON.stringify(times.map((t) => {
  element("slider").value = t;
  element("slider").listeners.input();
  const links = element("links").children.map(({ attributes }) => [attributes.class, attributes.d]);
  return { said: element("time").value, links };
})));
