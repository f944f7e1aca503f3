// Elements made by DOM calls: no markup is ever parsed from text, so none can be injected.

/** Find an element by its id. */
export const byId = (id) => document.getElementById(id);

const SVG = "http://www.w3.org/2000/svg";

function filled(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "text") node.textContent = value;
    else node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return node;
}

/** Make an element of HTML; attributes that begin with "on" are listeners, "text" is its text. */
export const make = (tag, attributes = {}, ...children) => filled(document.createElement(tag), attributes, children);

/** The same for SVG. */
export const draw = (tag, attributes = {}, ...children) =>
  filled(document.createElementNS(SVG, tag), attributes, children);

/** Something in a colour of the style sheet. */
export function coloured(node, colour) {
  node.style.setProperty("--colour", `var(--${colour})`);
  return node;
}

/** An icon of one path. */
export const icon = (path) => draw("svg", { viewBox: "0 0 24 24", "aria-hidden": "true" }, draw("path", { d: path }));

/** Call a function once, some milliseconds after the last of many calls. */
export function settled(milliseconds, call) {
  let waiting = 0;
  return (...given) => {
    clearTimeout(waiting);
    waiting = setTimeout(() => call(...given), milliseconds);
  };
}

/** Whether the reader asked for less motion. */
export const calm = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

const announcements = new Map();
const closed = new Set(); // sentences that the reader has closed, as long as they hold

/** Show one sentence about what went wrong, or take back the one of the same topic (null). */
export function complain(topic, sentence) {
  if (sentence === null) announcements.delete(topic);
  else announcements.set(topic, sentence);
  const all = new Set(announcements.values());
  for (const each of closed) if (!all.has(each)) closed.delete(each);
  const said = [...all].filter((each) => !closed.has(each)).at(-1) ?? "";
  if (byId("alert-says").textContent !== said) byId("alert-says").textContent = said;
  byId("alert").hidden = said === "";
}

/** Close all of them: none comes back until what it is about is asked anew. */
export function forgive() {
  for (const sentence of announcements.values()) closed.add(sentence);
  byId("alert-says").textContent = "";
  byId("alert").hidden = true;
}

/** Say something for a few seconds, to screen readers too. */
export function toast(sentence) {
  const shown = make("p", { class: "toast", text: sentence });
  const box = byId("toasts");
  while (box.childElementCount >= 2) box.firstElementChild.remove();
  box.append(shown);
  setTimeout(() => shown.remove(), 6000);
}
