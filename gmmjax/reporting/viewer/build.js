// Bundles src/index.js with three.js into one script that defines the global GmmjaxViewer.
//
//   npm ci && npm run build             writes ../assets/viewer.js
//   npm run build -- --out /tmp/v.js    writes elsewhere, as the test does that compares
//
// The versions are pinned, so the same sources give the same bytes.
import { readFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { parseArgs } from "node:util";

import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const { values } = parseArgs({ options: { out: { type: "string", default: join(here, "..", "assets", "viewer.js") } } });
const three = join(here, "node_modules", "three");
const { version } = JSON.parse(readFileSync(join(three, "package.json"), "utf8"));
const licence = readFileSync(join(three, "LICENSE"), "utf8").trim();

await build({
  absWorkingDir: here,
  entryPoints: ["src/index.js"],
  outfile: values.out,
  bundle: true,
  minify: true,
  format: "iife",
  globalName: "GmmjaxViewer",
  target: ["es2022"],
  charset: "ascii",
  legalComments: "none",
  banner: { js: `/*!\nBuilt from gmmjax/reporting/viewer by esbuild. Contains three.js ${version}, https://threejs.org\n\n${licence}\n*/` },
});
