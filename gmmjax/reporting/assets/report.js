"use strict";

// What the buttons, the rows and the keys of the report do; the viewer draws.
(() => {
  const element = (id) => document.getElementById(id);
  const all = (selector) => [...document.querySelectorAll(selector)];
  const scene = JSON.parse(element("scene").textContent);
  const list = element("changes");
  const toggles = all("button[data-toggle]");
  const color = element("color");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  let viewer = null;
  let chosen = null;

  // Settings of the views

  const isPressed = (button) => button.getAttribute("aria-pressed") === "true";
  const settings = () => ({
    ...Object.fromEntries(toggles.map((button) => [button.dataset.toggle, isPressed(button)])),
    color: color.value,
  });
  const press = (button, pressed) => {
    button.setAttribute("aria-pressed", String(pressed));
    viewer?.set({ [button.dataset.toggle]: pressed });
  };
  const setColor = (value) => {
    color.value = value;
    viewer?.set({ color: value });
    drawLegend();
  };

  const length = (value) => `${Number(value.toPrecision(3))}${scene.unit ? ` ${scene.unit}` : ""}`;
  const percent = (value) => `${Math.round(100 * value)} %`;
  const made = (name, text = "", className = "") => Object.assign(document.createElement(name), { textContent: text, className });

  function drawScale({ min, max, colors }) {
    const distance = color.value === "distance";
    const [low, high] = distance ? [`−${length(-min)}`, `+${length(max)}`] : [percent(min), percent(max)];
    const bar = made("span");
    bar.style.background = `linear-gradient(to right, ${colors.join(", ")})`;
    const scale = made("div", "", "ramp");
    const name = distance ? "signed distance to the other scan" : "probability of a change";
    scale.append(bar, made("b", low), made("em", name), made("b", high));
    element("legend").replaceChildren(scale);
  }
  function drawKinds(entries) {
    const names = made("ul");
    for (const { name, color: own } of entries) {
      const dot = made("i", "", "dot");
      dot.style.background = own;
      const entry = made("li");
      entry.append(dot, name);
      names.append(entry);
    }
    element("legend").replaceChildren(names);
  }
  function drawLegend() {
    const legend = viewer?.legend;
    if (legend?.type === "scale") drawScale(legend);
    if (legend?.type === "kinds") drawKinds(legend.entries);
    if (legend?.type === "scan") element("legend").textContent = "colours of the scan";
  }

  // Light and dark

  const theme = () => document.documentElement.dataset.theme ?? (dark.matches ? "dark" : "light");
  const themeChanged = () => {
    viewer?.setTheme(theme());
    drawLegend();
  };
  const switchTheme = () => {
    document.documentElement.dataset.theme = theme() === "dark" ? "light" : "dark";
    themeChanged();
  };

  // The chosen change

  const rowOf = (item) => item.querySelector(".row");
  const setOpen = (item, open) => {
    item.classList.toggle("chosen", open);
    rowOf(item).setAttribute("aria-expanded", String(open));
    item.querySelector(".card").hidden = !open;
  };
  const target = (item) => {
    if (item === null) return null;
    return "rejected" in item.dataset ? { rejected: Number(item.dataset.rejected) } : Number(item.dataset.labels.split(" ")[0]);
  };
  const caption = (item) => {
    const what = item.querySelector(".what b").textContent;
    return "rejected" in item.dataset ? `Rejected: ${what}` : `${item.querySelector(".label").textContent} · ${what}`;
  };

  // Where the list scrolls by itself, the page stays where it is.
  function show(item) {
    const own = item.parentElement;
    if (own.scrollHeight > own.clientHeight) own.scrollTop = item.offsetTop - own.offsetTop;
    else item.scrollIntoView({ block: innerWidth > 700 ? "nearest" : "start" });
  }

  function choose(item, { reveal = true } = {}) {
    if (chosen) setOpen(chosen, false);
    chosen = item;
    list?.classList.toggle("choosing", item !== null && "labels" in item.dataset);
    if (element("everything")) element("everything").disabled = item === null;
    element("focus").textContent = item ? caption(item) : "";
    if (item) {
      setOpen(item, true);
      if ("rejected" in item.dataset) element("rejected-section").open = true;
      if (reveal) show(item);
    }
    history.replaceState(null, "", item?.id ? `#${item.id}` : "#");
    viewer?.focus(target(item));
  }
  const toggleItem = (item) => choose(item === chosen ? null : item, { reveal: false });

  // A step from nothing chosen goes to the first change, or to the last one.
  function step(by) {
    const items = list ? [...list.children] : [];
    if (!items.length) return;
    const index = items.indexOf(chosen);
    const next = items[index < 0 ? (by > 0 ? 0 : items.length - 1) : (index + by + items.length) % items.length];
    choose(next);
    rowOf(next).focus({ preventScroll: true });
  }

  const ascending = new Set(["order", "label", "kind"]);
  function sort(by) {
    const value = (item) => (by === "kind" ? item.dataset.kind : Number(item.dataset[by]));
    const sign = ascending.has(by) ? 1 : -1;
    const items = [...list.children].sort((a, b) => {
      const [first, second] = [value(a), value(b)];
      return sign * (first > second) - sign * (first < second) || a.dataset.order - b.dataset.order;
    });
    list.append(...items);
  }

  // Keys

  const everything = () => {
    choose(null);
    viewer?.resetCamera();
  };
  const nextColor = () => setColor(color.options[(color.selectedIndex + 1) % color.options.length].value);
  const reset = () => viewer?.resetCamera();
  const keys = {
    j: () => step(1), n: () => step(1), ArrowDown: () => step(1),
    k: () => step(-1), p: () => step(-1), ArrowUp: () => step(-1),
    Escape: everything, c: nextColor, 0: reset, t: switchTheme, "?": () => element("keys").showModal(),
  };
  for (const button of toggles) keys[button.dataset.key] = () => press(button, !isPressed(button));

  document.addEventListener("keydown", (event) => {
    const { target: on, key } = event;
    if (event.ctrlKey || event.metaKey || event.altKey || element("keys").open) return;
    if (on.matches("select, input") || (on.matches("canvas") && key.startsWith("Arrow"))) return;
    const action = keys[key.length === 1 ? key.toLowerCase() : key];
    if (!action) return;
    event.preventDefault();
    action();
  });

  // Clicks

  for (const button of toggles) button.addEventListener("click", () => press(button, !isPressed(button)));
  for (const item of all("li.change")) rowOf(item).addEventListener("click", () => toggleItem(item));
  color.addEventListener("change", () => setColor(color.value));
  element("reset").addEventListener("click", reset);
  element("theme").addEventListener("click", switchTheme);
  element("help").addEventListener("click", () => element("keys").showModal());
  element("sort")?.addEventListener("change", (event) => sort(event.target.value));
  element("next")?.addEventListener("click", () => step(1));
  element("previous")?.addEventListener("click", () => step(-1));
  element("everything")?.addEventListener("click", everything);
  dark.addEventListener("change", themeChanged);

  // The viewer

  const onPick = (label) => {
    const item = list && [...list.children].find((one) => one.dataset.labels.split(" ").includes(String(label)));
    if (item) choose(item);
  };
  const withoutViews = (error) => {
    element("loading").hidden = true;
    document.querySelector(".stage").hidden = true;
    document.querySelector(".toolbar").hidden = true;
    element("pictures").classList.add("instead");
    element("no-view").hidden = false;
    element("no-view").textContent = `The views cannot be drawn: ${error.message}. These pictures and the list of changes do without them.`;
  };
  const linked = () => location.hash.startsWith("#change-") && element(location.hash.slice(1));

  async function start() {
    const canvases = { main: element("view-main"), before: element("view-before"), after: element("view-after") };
    const points = { before: element("points-before").textContent, after: element("points-after").textContent };
    viewer = await GmmjaxViewer.create({ scene, points, canvases, onPick });
    if (!viewer.state.available) throw new Error("WebGL 2 is missing or switched off");
    viewer.setTheme(theme());
    viewer.set(settings());
    drawLegend();
    window.gmmjaxReport = { viewer, choose };
    element("loading").hidden = true;
    const item = linked();
    if (item) choose(item);
  }
  // After the first picture of the page itself.
  requestAnimationFrame(() => setTimeout(() => start().catch(withoutViews)));
})();
