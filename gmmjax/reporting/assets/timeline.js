"use strict";

// Shows an object in the time line and in the plan at once: the one under the pointer or the focus, else the pinned one.
(() => {
  const parts = new Map();
  for (const part of document.querySelectorAll("[data-object]")) {
    const number = part.dataset.object;
    parts.set(number, [...(parts.get(number) ?? []), part]);
  }
  let pinned = null;
  let shown = null;

  const show = (number) => {
    if (number === shown) return;
    for (const part of parts.get(shown) ?? []) part.classList.remove("selected");
    shown = number;
    for (const part of parts.get(shown) ?? []) part.classList.add("selected");
    // The chosen one lies on top of its neighbours.
    for (const part of parts.get(shown) ?? []) {
      if (part.tagName === "g") part.parentNode.querySelector("path.scale").before(part);
    }
  };

  const press = (number, pressed) => {
    for (const part of parts.get(number) ?? []) part.querySelector("button")?.setAttribute("aria-pressed", pressed);
  };

  const pin = (number) => {
    press(pinned, false);
    pinned = pinned === number ? null : number;
    press(pinned, true);
    show(pinned);
  };

  const numberOf = (event) => event.target.closest?.("[data-object]")?.dataset.object ?? null;

  document.addEventListener("pointerover", (event) => { if (event.pointerType === "mouse") show(numberOf(event) ?? pinned); });
  document.addEventListener("focusin", (event) => show(numberOf(event) ?? pinned));
  document.addEventListener("click", (event) => {
    const number = numberOf(event);
    if (number === null || event.target.closest("a")) return;
    pin(number);
    if (event.target.closest("g")) {
      const row = parts.get(number).find((part) => part.tagName === "LI");
      row.querySelector(".mark").scrollIntoView({ block: "nearest", inline: "nearest" });
    }
  });
  document.addEventListener("keydown", (event) => { if (event.key === "Escape" && pinned !== null) pin(pinned); });
})();
