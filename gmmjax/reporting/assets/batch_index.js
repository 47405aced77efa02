"use strict";

// Lists the pairs of a run: searched, filtered, sorted, a page at a time. What is shown is kept in the fragment of the
// address, so that the way back from a report leads to it. Names, paths and messages become text, never markup.
(() => {
  const PAGE_SIZE = 50;
  const SHOWN_CHANGES = 3;
  const run = JSON.parse(document.getElementById("run").textContent);

  const pairs = run.pairs.map((values, index) => {
    const [
      name, status = "missing", error = null, before = null, after = null, pointsBefore = null, pointsAfter = null,
      changes = null, probability = null, standardError = null, restarts = null, settled = null, registered = null,
      residual = null, overlap = null, confidence = null, seconds = null, warnings = [], found = [],
    ] = values;
    return {
      index, name, status, error: error === null ? "" : run.texts[error], before, after, pointsBefore, pointsAfter,
      changes, probability, standardError, restarts, settled, registered, residual, overlap, confidence, seconds,
      warnings: warnings.map((text) => run.texts[text]),
      found: found.map(([kind, ofChange, ...extent]) => ({ kind, probability: ofChange, extent })),
    };
  });

  // What there is to sort by: heading, value, and what either order is called, the usual one first. The pairs come in
  // the order of their names. A column of which no pair has a value is not shown.
  const states = { failed: 0, missing: 1, done: 2 };
  const column = (key, label, value, first, second) => ({ key, label, value, first, second });
  const down = (words) => ["down", words];
  const up = (words) => ["up", words];
  const count = (pair, kind) => pair.found.filter((change) => change.kind === kind).length;
  const counts = (pair) => run.kinds.reduce((sum, _, kind) => 1000 * sum + Math.min(count(pair, kind), 999), 0);
  const columns = [
    column("name", "Pair", (pair) => pair.index, up("by name"), down("by name, last first")),
    column("status", "Status", (pair) => states[pair.status], up("failed first"), down("done first")),
    column("changes", "Changes", (pair) => pair.changes, down("most changes first"), up("fewest changes first")),
    column("kinds", "Kinds", (pair) => pair.changes === null ? null : counts(pair),
      down("most that appeared first"), up("fewest that appeared first")),
    column("probability", "Probability", (pair) => pair.probability,
      down("highest probability first"), up("lowest probability first")),
    column("deviation", "Std. error", (pair) => pair.standardError,
      down("largest standard error first"), up("smallest standard error first")),
    column("restarts", "Restarts", (pair) => pair.restarts, down("most restarts first"), up("fewest restarts first")),
    column("points", "Points", (pair) => pair.pointsBefore === null ? null : pair.pointsBefore + pair.pointsAfter,
      down("most points first"), up("fewest points first")),
    column("overlap", "Overlap", (pair) => pair.overlap, up("least overlap first"), down("most overlap first")),
    column("seconds", "Seconds", (pair) => pair.seconds, down("slowest first"), up("fastest first")),
  ].filter(({ key, value }) => key === "name" || pairs.some((pair) => value(pair) !== null));
  const orders = ({ first, second }) => [first, second];

  const filters = [
    { key: "all", label: "All", test: () => true },
    { key: "changed", label: "Changed", test: (pair) => pair.changes > 0 },
    { key: "unchanged", label: "Unchanged", test: (pair) => pair.changes === 0 },
    { key: "failed", label: "Failed", test: (pair) => pair.status === "failed" },
    { key: "missing", label: "Missing", test: (pair) => pair.status === "missing" },
    { key: "warnings", label: "With warnings", test: (pair) => pair.warnings.length > 0 },
  ];

  // ---- what is shown, and the fragment that says so

  const first = columns.find(({ key }) => key === "probability") ?? columns[0];
  const usual = { q: "", show: "all", sort: first.key, order: first.first[0], page: "1" };
  let state = usual;

  const readFragment = () => {
    const given = new URLSearchParams(location.hash.slice(1));
    const wanted = Object.fromEntries(Object.entries(usual).map(([key, value]) => [key, given.get(key) ?? value]));
    if (!filters.some((filter) => filter.key === wanted.show)) wanted.show = usual.show;
    if (!columns.some(({ key }) => key === wanted.sort)) wanted.sort = usual.sort;
    if (!["up", "down"].includes(wanted.order)) wanted.order = usual.order;
    state = wanted;
  };

  const writeFragment = () => {
    const kept = Object.entries(state).filter(([key, value]) => value !== usual[key]);
    const fragment = new URLSearchParams(kept).toString();
    history.replaceState(history.state, "", `${location.pathname}${location.search}${fragment ? `#${fragment}` : ""}`);
  };

  const go = (values) => {
    state = { ...state, page: "1", ...values };
    show();
    // Last, because browsers refuse it to pages that do it too often.
    writeFragment();
  };

  const sorting = () => columns.find(({ key }) => key === state.sort);

  const folded = (text) => text.normalize("NFKC").toLowerCase();
  const searched = (pair) => {
    const kinds = pair.found.map(({ kind }) => run.kinds[kind][0]);
    const texts = [pair.name, pair.status, pair.before, pair.after, pair.error, ...kinds, ...pair.warnings];
    pair.text ??= folded(texts.filter(Boolean).join("\n"));
    return pair.text;
  };

  const listed = () => {
    const { test } = filters.find((filter) => filter.key === state.show);
    const words = folded(state.q).split(/\s+/).filter(Boolean);
    const { value } = sorting();
    const sign = state.order === "up" ? 1 : -1;
    const chosen = pairs.filter((pair) => test(pair) && words.every((word) => searched(pair).includes(word)));
    const keyed = chosen.map((pair) => [value(pair), pair]);
    // What is not known comes last, either way.
    keyed.sort(([a, first], [b, second]) =>
      (a === null) - (b === null) || (a === null ? 0 : sign * (a - b)) || first.index - second.index);
    return keyed.map(([, pair]) => pair);
  };

  // ---- elements

  const make = (tag, properties = {}, ...children) => {
    const element = Object.assign(document.createElement(tag), properties);
    element.append(...children.filter((child) => child !== null && child !== ""));
    return element;
  };
  const small = (text) => make("small", {}, text);
  const dot = (kind) => {
    const element = make("i", { className: "dot" });
    element.style.background = run.kinds[kind][1];
    return element;
  };
  const lines = (...texts) => texts.filter(Boolean).map(small);

  const whole = new Intl.NumberFormat("en");
  const percent = (part) => `${part > 0.99 && part < 1 ? Math.floor(100 * part) : Math.round(100 * part)} %`;
  const inPoints = (part) => `± ${(100 * part).toFixed(part < 0.1 ? 1 : 0)} %`;
  const brief = (value) => String(Number(value.toPrecision(2)));
  const size = (extent) => {
    const digits = extent[0] > 0 ? Math.min(Math.max(2 - Math.floor(Math.log10(extent[0])), 0), 9) : 3;
    return extent.map((edge) => edge.toFixed(digits)).join(" × ");
  };
  const known = (value, format) => value === null ? "–" : format(value);
  const folder = (pair) => `pairs/${encodeURIComponent(pair.name)}`;

  const thumbnail = (pair, side) => {
    const image = make("img", { width: 160, height: 120, loading: "lazy", decoding: "async" });
    image.alt = `${pair.name}, ${side}`;
    // A run without thumbnails keeps the place and says nothing.
    image.addEventListener("error", () => image.replaceWith(make("span", { className: "empty" })));
    image.src = `${folder(pair)}/${side}.webp`;
    return image;
  };

  const thumbnails = (pair) => {
    if (pair.status !== "done") return make("span", { className: "thumbnails" });
    const link = make("a", { className: "thumbnails", href: `${folder(pair)}/report.html`, tabIndex: -1 });
    link.append(thumbnail(pair, "before"), thumbnail(pair, "after"));
    return link;
  };

  // Both files on one line, the folder that they share once; lines break after a slash.
  const paths = (before, after) => {
    const shared = before.slice(0, before.lastIndexOf("/") + 1);
    const own = after.startsWith(shared) ? after.slice(shared.length) : after;
    const parts = `${before} → ${own}`.split(/(?<=\/)/).flatMap((part) => [part, make("wbr")]);
    return make("small", { className: "path", dir: "auto", title: `${before}\n${after}` }, ...parts);
  };

  const title = (pair) => {
    const name = make("b", { textContent: pair.name, dir: "auto" });
    const cell = [pair.status === "done" ? make("a", { href: `${folder(pair)}/report.html` }, name) : name];
    if (pair.before && pair.after) cell.push(paths(pair.before, pair.after));
    if (pair.error) {
      const more = make("a", { href: `errors/${encodeURIComponent(pair.name)}.json` }, "details");
      cell.push(make("p", { className: "error" }, make("span", { textContent: pair.error, dir: "auto" }), " ", more));
    }
    cell.push(...pair.warnings.map((text) => make("p", { className: "warning", textContent: text, dir: "auto" })));
    return cell;
  };

  const changeList = (pair) => {
    if (!pair.found.length) return [make("span", { className: "none" }, "No change found")];
    const items = pair.found.slice(0, SHOWN_CHANGES).map(({ kind, probability, extent }) =>
      make("li", {}, dot(kind), `${run.kinds[kind][0]} `, make("b", {}, percent(probability)), small(size(extent))));
    const more = pair.found.length - SHOWN_CHANGES;
    const rest = make("a", { href: `${folder(pair)}/report.html` }, `${more} more in the report`);
    if (more > 0) items.push(make("li", {}, rest));
    return [make("ul", { className: "found" }, ...items)];
  };

  const registration = ({ registered, residual, confidence }) => lines(
    registered ? "registered" : "",
    residual === null ? "" : `residual ${brief(residual)}`,
    confidence !== null && confidence < 0.99 ? `confidence ${percent(confidence)}` : "",
  );

  const results = (pair) => ({
    changes: [known(pair.changes, whole.format)],
    kinds: changeList(pair),
    probability: [known(pair.probability, percent)],
    deviation: [known(pair.standardError, inPoints)],
    restarts: [known(pair.restarts, whole.format), ...lines({ true: "settled", false: "not settled" }[pair.settled])],
    points: [known(pair.pointsBefore, whole.format), small(`→ ${known(pair.pointsAfter, whole.format)}`)],
    overlap: [known(pair.overlap, percent), ...registration(pair)],
    seconds: [known(pair.seconds, (value) => value.toFixed(1))],
  });

  const row = (pair) => {
    const element = make("tr", { className: pair.status, role: "row" });
    element.append(make("td", { className: "pictures", role: "cell" }, thumbnails(pair)));
    const status = [make("span", { className: `status ${pair.status}` }, pair.status)];
    const cells = { name: title(pair), status, ...(pair.status === "done" ? results(pair) : {}) };
    for (const { key, label } of columns) {
      const cell = make("td", { className: key, role: "cell" }, ...(cells[key] ?? []));
      cell.dataset.label = label;
      element.append(cell);
    }
    return element;
  };

  // ---- the page around the list

  const search = make("input", { type: "search", placeholder: "Search names, files, kinds, errors" });
  search.setAttribute("aria-label", "Search names, status, kinds, files, warnings and errors");
  search.addEventListener("input", () => go({ q: search.value }));

  const filterButtons = filters.map(({ key, label, test }) => {
    const number = pairs.filter(test).length;
    const button = make("button", { type: "button" }, label, small(whole.format(number)));
    button.hidden = key !== "all" && number === 0;
    button.addEventListener("click", () => go({ show: key }));
    return [key, button];
  });

  const headings = columns.map(({ key, label, first }) => {
    const button = make("button", { type: "button" }, label);
    button.addEventListener("click", () => {
      const reversed = state.order === "up" ? "down" : "up";
      go({ sort: key, order: state.sort === key ? reversed : first[0] });
    });
    const heading = make("th", { scope: "col", className: key, role: "columnheader" }, button);
    return [key, heading];
  });

  // On a phone there is no row of headings to press.
  const chooser = make("select", {}, ...columns.flatMap((one) =>
    orders(one).map(([order, words]) => make("option", { value: `${one.key} ${order}` }, words))));
  chooser.addEventListener("change", () => {
    const [sort, order] = chooser.value.split(" ");
    go({ sort, order });
  });

  const said = make("p", { className: "said" });
  said.setAttribute("role", "status");
  const body = make("tbody", { role: "rowgroup" });
  const pager = make("nav", { className: "pager" });
  pager.setAttribute("aria-label", "Pages");

  const pictures = make("th", { scope: "col", className: "pictures", role: "columnheader" }, "Before and after");
  const table = make("table", { className: "pairs", role: "table" },
    make("thead", { role: "rowgroup" },
      make("tr", { role: "row" }, pictures, ...headings.map(([, heading]) => heading))),
    body);
  const chips = make("div", { className: "filters", role: "group" }, ...filterButtons.map(([, button]) => button));
  chips.setAttribute("aria-label", "Which pairs");
  const list = document.getElementById("index");
  list.append(
    make("div", { className: "controls" }, search, chips, make("label", { className: "sorting" }, "Order ", chooser)),
    said, table, pager);

  const turn = (label, page, pages) => {
    const button = make("button", { type: "button" }, label);
    // A disabled button would lose the keyboard's focus.
    button.setAttribute("aria-disabled", String(page < 1 || page > pages));
    button.addEventListener("click", () => {
      if (page < 1 || page > pages) return;
      go({ page: String(page) });
      list.scrollIntoView();
      pager.querySelector(`[data-turn="${button.dataset.turn}"]`).focus({ preventScroll: true });
    });
    button.dataset.turn = label;
    return button;
  };

  const show = () => {
    const chosen = listed();
    const pages = Math.max(1, Math.ceil(chosen.length / PAGE_SIZE));
    const page = Math.min(Math.max(Math.trunc(Number(state.page)) || 1, 1), pages);
    const first = (page - 1) * PAGE_SIZE;
    const [, words] = orders(sorting()).find(([order]) => order === state.order);
    if (search.value !== state.q) search.value = state.q;
    chooser.value = `${state.sort} ${state.order}`;
    for (const [key, button] of filterButtons) button.setAttribute("aria-pressed", String(key === state.show));
    for (const [key, heading] of headings) {
      if (key === state.sort) heading.setAttribute("aria-sort", state.order === "up" ? "ascending" : "descending");
      else heading.removeAttribute("aria-sort");
    }
    const last = Math.min(first + PAGE_SIZE, chosen.length);
    const range = pages > 1 ? `${whole.format(first + 1)} to ${whole.format(last)} of ` : "";
    said.textContent = chosen.length
      ? `${range}${whole.format(chosen.length)} pair${chosen.length === 1 ? "" : "s"}, ${words}`
      : "No such pair";
    body.replaceChildren(...chosen.slice(first, last).map(row));
    pager.replaceChildren(...(pages > 1 ? [
      turn("First", page > 1 ? 1 : 0, pages), turn("Previous", page - 1, pages),
      make("span", {}, `Page ${page} of ${pages}`),
      turn("Next", page + 1, pages), turn("Last", page < pages ? pages : pages + 1, pages),
    ] : []));
  };

  addEventListener("hashchange", () => { readFragment(); show(); });
  readFragment();
  show();
})();
