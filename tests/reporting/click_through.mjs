// Clicks through a report as a reader would: rows, toggles, colours, keys, picking, what was turned down, a phone.
//
//   node click_through.mjs CHROMIUM REPORT [CHANGES_JSON]
//
// It fails on any error of the console, on any request, when a click changes nothing, and when the page and
// changes.json disagree.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";

import { colored, launched, opened, picture, settled, state } from "./browser.mjs";

const [chromium, report, record] = process.argv.slice(2);
const KINDS = { appeared: "#009E73", disappeared: "#D55E00", moved: "#0072B2" };

// The last picture, which need not be taken again while the state is the same.
let last = { state: null, picture: null };

async function looked(page) {
  const now = await state(page);
  if (now !== last.state) last = { state: now, picture: await picture(page) };
  return last;
}

/** Does something, and checks that it changed the viewer's state and what is seen of it. */
async function changes(page, what, action, { seen = true } = {}) {
  const before = await looked(page);
  await action();
  await settled(page);
  assert.notEqual(await state(page), before.state, `${what}: the viewer's state is as it was`);
  if (seen) assert.notEqual((await looked(page)).picture, before.picture, `${what}: nothing changed on the screen`);
}

const focus = async (page) => JSON.parse(await state(page)).focus;
const setting = async (page, name) => JSON.parse(await state(page))[name];

async function everyRow(page, found) {
  const rows = page.locator("#changes > li");
  for (let index = 0; index < (await rows.count()); index++) {
    const row = rows.nth(index);
    const labels = (await row.getAttribute("data-labels")).split(" ").map(Number);
    await changes(page, `row ${labels}`, () => row.locator(".row").click());
    assert.ok(labels.includes(await focus(page)), `row ${labels}: the view looks at ${await focus(page)}`);
    assert.ok(await row.locator(".card").isVisible(), `row ${labels}: its card is closed`);
    const color = KINDS[await row.getAttribute("data-kind")];
    const { count } = await colored(page, (await looked(page)).picture, color);
    assert.ok(count > 200, `row ${labels}: ${count} pixels in its colour, the change is not seen`);
    if (found) await agrees(row, labels, found);
  }
  const first = rows.first().locator(".row");
  await first.focus();
  await changes(page, "Enter on a row", () => page.keyboard.press("Enter"));
  await changes(page, "a second click on the row", () => first.click());
  assert.equal(await focus(page), null);
}

/** Whether the card says what changes.json does. */
async function agrees(row, labels, found) {
  const names = await row.locator(".properties dt").allTextContents();
  const texts = await row.locator(".properties dd").allTextContents();
  const card = Object.fromEntries(names.map((name, index) => [name, texts[index]]));
  const numbers = (text) => text.match(/-?[\d,.]+(e[-+]?\d+)?/g).map((one) => Number(one.replaceAll(",", "")));
  const change = found.changes[labels.at(-1)];
  const near = (shown, wanted, scale, what) =>
    wanted.forEach((value, axis) => assert.ok(Math.abs(shown[axis] - value) <= 0.006 * scale, `${what} of ${labels}`));
  const longest = Math.max(...change.box.extent);
  near(numbers(card.Size), change.box.extent, longest, "size");
  const position = card["Position after"] ?? card.Position;
  near(position.split(", ").map(parseFloat), change.mean, longest, "position");
  near(numbers(card.Points), [change.point_count], 1, "points");
  // To whole percents, but only certainty is 100 %.
  const probable = Math.max(...labels.map((label) => found.changes[label].probability));
  near(numbers(card.Probability), [100 * probable], 170, "probability");
  if (change.volume === null) return assert.equal(card.Volume, undefined);
  const unit = card.Volume.includes("cm³") && found.unit === "m" ? 1e-6 : 1;
  // To two digits: 0.104 is 0.10.
  near([numbers(card.Volume)[0] * unit], [change.volume], 9 * change.volume, "volume");
}

async function everyToggle(page, withChanges) {
  await page.keyboard.press("Escape");
  await settled(page);
  for (const button of await page.locator("button[data-toggle]").all()) {
    const name = await button.getAttribute("data-toggle");
    const pressed = await button.getAttribute("aria-pressed");
    // Clipping is seen only where something is chosen, blinking at its next turn.
    const seen = !["clip", "blink"].includes(name);
    await changes(page, name, () => button.click(), { seen });
    assert.notEqual(await button.getAttribute("aria-pressed"), pressed);
    await changes(page, `${name} again`, () => button.click(), { seen });
    const key = await button.getAttribute("data-key");
    await changes(page, `${name} by its key`, () => page.keyboard.press(key), { seen });
    await page.keyboard.press(key);
    await settled(page);
  }
  if (withChanges) {
    await page.keyboard.press("j");
    await settled(page);
    await changes(page, "clip at a change", () => page.locator('[data-toggle="clip"]').click());
    await page.keyboard.press("x");
    await page.keyboard.press("Escape");
    await settled(page);
  }
}

async function everyColor(page) {
  const names = await page.locator("#color option").evaluateAll((options) => options.map((option) => option.value));
  const first = await page.locator("#color").inputValue();
  for (const name of [...names.filter((one) => one !== first), first]) {
    const legend = await page.locator("#legend").textContent();
    await changes(page, `colour by ${name}`, () => page.locator("#color").selectOption(name));
    assert.notEqual(await page.locator("#legend").textContent(), legend, `colour by ${name}: the legend is as it was`);
  }
  await page.locator("#view-main").focus();
  await changes(page, "the next colour by key", () => page.keyboard.press("c"));
  await page.locator("#color").selectOption(first);
}

async function everyKey(page, count) {
  await page.keyboard.press("Escape");
  for (const [next, previous] of [["j", "k"], ["n", "p"]]) {
    await changes(page, next, () => page.keyboard.press(next));
    const first = await focus(page);
    if (count > 1) await changes(page, next, () => page.keyboard.press(next));
    if (count > 1) await changes(page, previous, () => page.keyboard.press(previous));
    assert.equal(await focus(page), first);
    await changes(page, "Escape", () => page.keyboard.press("Escape"));
    assert.equal(await focus(page), null);
  }
  await page.evaluate(() => document.activeElement.blur());
  await changes(page, "the arrow down", () => page.keyboard.press("ArrowDown"));
  await changes(page, "the button for everything", () => page.locator("#everything").click());
  await page.locator("#next").click();
  assert.notEqual(await focus(page), null);
  await page.keyboard.press("Escape");
  await settled(page);
}

async function theView(page) {
  const { x, y, width, height } = await page.locator("#view-main").boundingBox();
  await changes(page, "dragging", async () => {
    await page.mouse.move(x + width / 2, y + height / 2);
    await page.mouse.down();
    await page.mouse.move(x + width / 2 + 120, y + height / 2 + 40, { steps: 4 });
    await page.mouse.up();
  });
  await changes(page, "the reset of the view", () => page.keyboard.press("0"));
  await page.keyboard.press("t");
  await settled(page);
  assert.equal(await setting(page, "theme"), "dark");
  await changes(page, "light and dark", () => page.locator("#theme").click());
  await page.keyboard.press("?");
  assert.ok(await page.locator("#keys").isVisible(), "the list of keys is not shown");
  await page.keyboard.press("Escape");
  assert.ok(!(await page.locator("#keys").isVisible()));
}

async function picking(page) {
  const boxes = page.locator('[data-toggle="boxes"]');
  await boxes.click();
  await settled(page);
  const kind = await page.locator("#changes > li").first().getAttribute("data-kind");
  const { count, x, y } = await colored(page, await picture(page), KINDS[kind]);
  assert.ok(count, "no point of a change is seen");
  await changes(page, "a click on a change in the view", () => page.locator("#stage").click({ position: { x, y } }));
  assert.ok(await page.locator("#changes > li.chosen .card").isVisible(), "picking opened no card");
  await boxes.click();
  await page.keyboard.press("Escape");
  await settled(page);
}

async function sorting(page) {
  const order = () => page.locator("#changes > li").evaluateAll((rows) => rows.map((row) => row.id).join());
  const sorted = new Set([await order()]);
  for (const by of ["label", "kind", "size", "volume", "points", "order"]) {
    await page.locator("#sort").selectOption(by);
    sorted.add(await order());
  }
  assert.ok(sorted.size > 1, "the order of the rows never changes");
}

async function turnedDown(page) {
  await page.locator("#rejected-section > summary").click();
  const row = page.locator("#rejected > li").first();
  await changes(page, "a rejected candidate", () => row.locator(".row").click());
  assert.deepEqual(await focus(page), { rejected: 0 });
  assert.ok(await row.locator(".card").isVisible());
  await page.keyboard.press("Escape");
}

async function onPaper(page) {
  await page.emulateMedia({ media: "print" });
  assert.ok(await page.locator("#pictures img").first().isVisible(), "nothing is printed in place of the views");
  for (const card of await page.locator("#changes .card").all()) assert.ok(await card.isVisible());
  const loaded = await page.locator("img").evaluateAll((images) =>
    Promise.all(images.map((image) => ((image.loading = "eager"), image.decode().then(() => image.naturalWidth > 0)))),
  );
  assert.ok(loaded.every(Boolean), "a picture is broken");
  await page.emulateMedia({ media: "screen" });
}

async function onAPhone(browser, count) {
  const { page, errors } = await opened(browser, report, { width: 390, height: 780 });
  const overflow = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
  assert.ok(overflow <= 0, `the page is ${overflow} pixels wider than a phone`);
  if (count) {
    const row = page.locator("#changes .row").first();
    await row.scrollIntoViewIfNeeded();
    await row.click();
    await settled(page);
    assert.notEqual(await focus(page), null);
    assert.ok(await page.locator("#view-main").isVisible());
  }
  assert.deepEqual(errors, []);
  await page.close();
}

const browser = await launched(chromium);
try {
  const found = record ? JSON.parse(await readFile(record, "utf8")) : null;
  const { page, errors } = await opened(browser, report, { width: 1200, height: 720 });
  const count = await page.locator("#changes > li").count();
  if (count) {
    await everyRow(page, found);
    await everyKey(page, count);
    await picking(page);
    await sorting(page);
  }
  await everyToggle(page, count > 0);
  await everyColor(page);
  await theView(page);
  if (await page.locator("#rejected-section").count()) await turnedDown(page);
  await onPaper(page);
  assert.deepEqual(errors, []);
  await page.close();
  await onAPhone(browser, count);
  console.log(`${count} rows`);
} finally {
  await browser.close();
}
