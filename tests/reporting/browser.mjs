// What the scripts that look at pages share: a headless Chromium, the page in it, and what can be measured there.

import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const viewer = new URL("../../gmmjax/reporting/viewer/", import.meta.url);
const { chromium } = createRequire(viewer)("playwright-core");
const SOFTWARE = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"];

export function launched(executablePath) {
  return chromium.launch({ executablePath, args: SOFTWARE });
}

/** A page in a new window; `errors` collects what the console or the network complains of. */
export async function opened(browser, file, { width = 1280, height = 860, dark = false, scale = 1 } = {}) {
  const page = await browser.newPage({
    viewport: { width, height },
    deviceScaleFactor: scale,
    colorScheme: dark ? "dark" : "light",
    reducedMotion: "reduce",
  });
  const errors = [];
  page.on("console", (message) => message.type() === "error" && errors.push(message.text()));
  page.on("pageerror", (error) => errors.push(error.message));
  page.on("request", (request) => /^(file|data|blob):/.test(request.url()) || errors.push(`asks for ${request.url()}`));
  await page.goto(pathToFileURL(file).href);
  // A report draws its points first.
  await page.waitForFunction(() => window.gmmjaxReport || !document.getElementById("scene"), null, { timeout: 120_000 });
  await settled(page);
  return { page, errors };
}

export async function settled(page) {
  await page.evaluate(() => window.gmmjaxReport?.viewer.settled);
  // The pictures of the last frame still have to reach the screen.
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
}

export function state(page) {
  return page.evaluate(() => {
    const { frameSeconds, pointsPerFrame, ...rest } = window.gmmjaxReport.viewer.state;
    return JSON.stringify(rest);
  });
}

export async function picture(page, selector = "#stage") {
  return (await page.locator(selector).screenshot()).toString("base64");
}

/** The pixels of a picture that have nearly this colour: how many, and one in their midst. */
export function colored(page, png, color, tolerance = 48) {
  return page.evaluate(
    async ([content, wanted, most]) => {
      const image = new Image();
      image.src = `data:image/png;base64,${content}`;
      await image.decode();
      const canvas = new OffscreenCanvas(image.width, image.height);
      const context = canvas.getContext("2d");
      context.drawImage(image, 0, 0);
      const { data } = context.getImageData(0, 0, image.width, image.height);
      const channels = [1, 3, 5].map((start) => parseInt(wanted.slice(start, start + 2), 16));
      const found = [];
      for (let index = 0; index < data.length; index += 4) {
        if (channels.every((value, channel) => Math.abs(data[index + channel] - value) <= most)) found.push(index / 4);
      }
      const middle = found[Math.floor(found.length / 2)] ?? 0;
      return { count: found.length, x: middle % image.width, y: Math.floor(middle / image.width) };
    },
    [png, color, tolerance],
  );
}
