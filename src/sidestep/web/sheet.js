// On narrow screens the panel is a sheet that rises from below: it shows its head, half of the screen, or nearly all.

import { byId, calm } from "./dom.js";
import { frameAgain } from "./map.js";

const STOPS = ["low", "half", "high"];

/** Begin. */
export function startSheet() {
  const handle = byId("sheet");
  const panel = byId("panel");
  const set = (stop) => {
    panel.dataset.sheet = stop;
    document.documentElement.dataset.sheet = stop;
    handle.setAttribute("aria-expanded", String(stop !== "low"));
    byId("sheet-says").textContent = stop === "high" ? "Show less" : "Show more";
    if (calm()) frameAgain(); // nothing moves whose end could be waited for
  };
  set("low");
  // The sheet, hints and messages leave free what the time takes, which is higher where it has more to explain.
  const time = document.querySelector(".time");
  const below = () =>
    document.documentElement.style.setProperty("--below-time", `${time.getBoundingClientRect().bottom}px`);
  new ResizeObserver(below).observe(time);
  panel.addEventListener("transitionend", (event) => event.target === panel && frameAgain());
  let drag = null;
  handle.addEventListener("pointerdown", (event) => {
    drag = { y: event.clientY, stop: STOPS.indexOf(panel.dataset.sheet), moved: false };
    handle.setPointerCapture(event.pointerId);
  });
  handle.addEventListener("pointermove", (event) => {
    if (!drag) return;
    const by = drag.y - event.clientY;
    if (Math.abs(by) > 8) drag.moved = true;
    panel.style.setProperty("--pulled", `${by}px`);
  });
  const drop = (event) => {
    if (!drag) return;
    const by = drag.y - event.clientY;
    panel.style.removeProperty("--pulled");
    if (drag.moved)
      set(STOPS[Math.min(2, Math.max(0, drag.stop + Math.sign(by) * (Math.abs(by) > innerHeight * 0.4 ? 2 : 1)))]);
    handle.dataset.dragged = drag.moved ? "yes" : "";
    drag = null;
  };
  handle.addEventListener("pointerup", drop);
  handle.addEventListener("pointercancel", drop);
  handle.addEventListener("click", () => {
    if (handle.dataset.dragged) {
      handle.dataset.dragged = "";
      return;
    }
    set({ low: "half", half: "high", high: "low" }[panel.dataset.sheet]);
  });
  // Typing and reading need room.
  const rise = () => panel.dataset.sheet === "low" && set("half");
  panel.addEventListener("focusin", (event) => event.target.matches("input[role=combobox]") && rise());
  panel.addEventListener("click", (event) => event.target.matches("[role=tab], #summary") && rise());
}
