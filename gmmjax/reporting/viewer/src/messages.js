// What stands in the place of the canvases when nothing can be drawn.

export const MISSING =
  "This browser cannot draw the points here: WebGL 2 is missing or switched off. Everything else on this page works without it.";
export const LOST = "The browser has taken the graphics memory away. The points come back as soon as it is given back.";

export class Messages {
  #shown = [];

  constructor(canvases) {
    this.canvases = canvases;
  }

  show(text) {
    this.clear();
    for (const canvas of this.canvases) {
      const message = document.createElement("p");
      message.className = "viewer-message";
      message.setAttribute("role", "status");
      message.textContent = text;
      canvas.style.display = "none";
      canvas.after(message);
      this.#shown.push(message);
    }
  }

  clear() {
    for (const message of this.#shown.splice(0)) message.remove();
    for (const canvas of this.canvases) canvas.style.display = "";
  }
}
