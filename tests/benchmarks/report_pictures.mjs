// Takes pictures of pages, as a JSON file lists them:
//
//   node report_pictures.mjs CHROMIUM LIST
//
// [{ file, picture, width, height, dark, scale, keys: [], clicks: [] }]; it fails on any error of the console.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";

import { launched, opened, settled } from "../reporting/browser.mjs";

const [chromium, list] = process.argv.slice(2);
const browser = await launched(chromium);
try {
  for (const shot of JSON.parse(await readFile(list, "utf8"))) {
    const { page, errors } = await opened(browser, shot.file, shot);
    for (const key of shot.keys) await page.keyboard.press(key);
    for (const selector of shot.clicks) await page.locator(selector).first().click();
    await settled(page);
    const images = page.locator(".card:not([hidden]) img, .thumbnails img");
    await images.evaluateAll((found) => Promise.all(found.map((image) => image.decode())));
    await page.evaluate(() => document.activeElement.blur());
    await page.screenshot({ path: shot.picture });
    assert.deepEqual(errors, []);
    await page.close();
  }
} finally {
  await browser.close();
}
