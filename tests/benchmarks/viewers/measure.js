// Size, first picture and frames a second of libraries that draw 2 x 1 million points, in headless Chromium without a
// graphics card:
//
//   npm ci
//   node measure.js --chromium /usr/bin/chromium --plotly PLOTLY.MIN.JS [--points 1000000] [--only three]
//   node measure.js --report result/report.html
//
// The libraries draw all points in every frame. The second command drags the main view of a report, which leaves points
// out while the camera moves.
import { mkdtempSync, readFileSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { parseArgs } from "node:util";

import { build } from "esbuild";
import puppeteer from "puppeteer-core";

const here = dirname(fileURLToPath(import.meta.url));
const { values } = parseArgs({
  options: {
    chromium: { type: "string", default: "/usr/bin/chromium" },
    plotly: { type: "string" },
    points: { type: "string", default: "1000000" },
    rounds: { type: "string", default: "3" },
    only: { type: "string" },
    report: { type: "string" },
  },
});
const CONTENDERS = { webgl: "WebGL 2 alone", regl: "regl 2.1.1", three: "three.js 0.187.0", deck: "deck.gl 9.4.0", plotly: "plotly.js" };
const folder = mkdtempSync(join(tmpdir(), "viewers-"));

async function bundled(name) {
  const result = await build({
    stdin: { contents: `export { clouds } from "./points.js"; export { start } from "./${name}.js";`, resolveDir: here },
    bundle: true, minify: true, format: "iife", globalName: "Contender", target: ["es2022"], write: false, legalComments: "none",
  });
  const library = name === "plotly" ? readFileSync(values.plotly, "utf8") : "";
  return library + "\n;" + result.outputFiles[0].text;
}

async function measured(browser, file) {
  const page = await browser.newPage();
  page.on("pageerror", (error) => { throw error; });
  await page.setViewport({ width: 1000, height: 800 });
  await page.goto(`file://${file}`);
  const result = await page.evaluate(async (count) => {
    const clouds = Contender.clouds(count);
    const finished = async () => {
      for (const canvas of document.querySelectorAll("canvas")) {
        const gl = canvas.getContext("webgl2") ?? canvas.getContext("webgl");
        gl?.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      }
    };
    const begin = performance.now();
    const draw = await Contender.start(document.querySelector("canvas"), clouds);
    await draw(0);
    await finished();
    const first = performance.now() - begin;
    const frames = performance.now();
    let drawn = 0;
    while (drawn < 2 || performance.now() - frames < 4000) {
      await draw(0.05 * ++drawn);
      await finished();
      await new Promise((resolve) => requestAnimationFrame(resolve));
    }
    return { first, rate: (1000 * drawn) / (performance.now() - frames) };
  }, Number(values.points));
  await page.close();
  return result;
}

/** First picture, frames a second while it is dragged, and all points after that, of a report. */
async function measuredReport(browser, file) {
  const page = await browser.newPage();
  await page.setViewport({ width: 1400, height: 900 });
  await page.evaluateOnNewDocument(() => {
    window.pictures = [];
    const { drawImage } = CanvasRenderingContext2D.prototype;
    CanvasRenderingContext2D.prototype.drawImage = function (...values) {
      if (this.canvas.id === "view-main") window.pictures.push(performance.now());
      return drawImage.apply(this, values);
    };
  });
  await page.goto(`file://${file}`);
  await page.waitForFunction("window.gmmjaxReport && window.pictures.length", { timeout: 300000 });
  await page.evaluate("gmmjaxReport.viewer.settled");
  const first = await page.evaluate("pictures[0]");
  const rate = await page.evaluate(async () => {
    const canvas = document.getElementById("view-main");
    const { left, top, width, height } = canvas.getBoundingClientRect();
    const pointer = (type, x) => canvas.dispatchEvent(new PointerEvent(type, {
      bubbles: true, cancelable: true, pointerId: 1, pointerType: "mouse", isPrimary: true, button: 0, buttons: 1,
      clientX: left + width / 2 + x, clientY: top + height / 2, pageX: left + width / 2 + x, pageY: top + height / 2,
    }));
    canvas.setPointerCapture = canvas.releasePointerCapture = () => {};
    pointer("pointerdown", 0);
    let [begin, counted, step] = [performance.now(), null, 0];
    while (performance.now() - begin < 6000) {
      pointer("pointermove", 3 * ++step);
      await new Promise((resolve) => requestAnimationFrame(resolve));
      // After two seconds it has found out how many points it can draw.
      if (counted === null && performance.now() - begin > 2000) counted = [pictures.length, performance.now()];
    }
    const rate = (1000 * (pictures.length - counted[0])) / (performance.now() - counted[1]);
    pointer("pointerup", 3 * step);
    return rate;
  });
  const still = await page.evaluate("performance.now()");
  await page.evaluate("gmmjaxReport.viewer.settled");
  const all = (await page.evaluate("performance.now()")) - still;
  await page.close();
  return { first, rate, all };
}

const median = (numbers) => [...numbers].sort((a, b) => a - b)[numbers.length >> 1];
const browser = await puppeteer.launch({
  executablePath: values.chromium,
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"],
  protocolTimeout: 600000,
});
if (values.report) {
  const { first, rate, all } = await measuredReport(browser, resolve(values.report));
  console.log(`first picture ${(first / 1000).toFixed(2)} s, ${rate.toFixed(1)} frames a second, all points after ${(all / 1000).toFixed(2)} s`);
  await browser.close();
  process.exit();
}
const names = Object.keys(CONTENDERS)
  .filter((name) => (name !== "plotly" || values.plotly) && (!values.only || values.only === name));
const results = Object.fromEntries(names.map((name) => [name, []]));
const sizes = {};
for (const name of names) {
  const script = await bundled(name);
  sizes[name] = Buffer.byteLength(script);
  writeFileSync(join(folder, `${name}.html`), `<!doctype html><meta charset="utf-8"><body style="margin:0"><canvas width="1000" height="800"></canvas><script>${script}</script>`);
}
for (let round = 0; round < Number(values.rounds); round++) {
  for (const name of names) results[name].push(await measured(browser, join(folder, `${name}.html`)));
}
await browser.close();
console.log("| Library | Script (MB) | First picture (s) | Frames a second |\n|---|---:|---:|---:|");
for (const name of names) {
  const [first, rate] = ["first", "rate"].map((what) => median(results[name].map((result) => result[what])));
  console.log(`| ${CONTENDERS[name]} | ${(sizes[name] / 1e6).toFixed(2)} | ${(first / 1000).toFixed(2)} | ${rate.toFixed(2)} |`);
}
