// src/ and three.js -> ../pyinfra/viz/viewer/viewer.min.js; run by `make viewer`.
// The first line says which sources the bundle was made of; a test compares it.
import { createHash } from "node:crypto";
import { readdirSync, readFileSync } from "node:fs";
import { build } from "esbuild";

const own = readdirSync("src").map((name) => `src/${name}`);
const sources = [...own, "build.mjs", "package-lock.json", "package.json"].sort();
const hash = createHash("sha256");
for (const name of sources) hash.update(`${name}\0`).update(readFileSync(name)).update("\0");
const licence = readFileSync("node_modules/three/LICENSE", "utf8").trim();

await build({
  entryPoints: ["src/main.js"],
  outfile: "../pyinfra/viz/viewer/viewer.min.js",
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  legalComments: "none", // the banner has the whole licence
  banner: { js: `/*! sources sha256 ${hash.digest("hex")}\n\nThree.js, https://threejs.org\n\n${licence}\n*/` },
  logLevel: "info",
});
