// Builds the page: `node build.mjs [FOLDER]`, ../built by default. The same sources, lock file and
// esbuild give the same bytes.
import { build } from "esbuild";
import { copyFile, mkdir, readFile } from "node:fs/promises";
import path from "node:path";
import { fileURLToPath } from "node:url";

const here = path.dirname(fileURLToPath(import.meta.url));
const out = path.resolve(process.argv[2] ?? path.join(here, "..", "built"));
const license = await readFile(path.join(here, "node_modules", "preact", "LICENSE"), "utf8");

await mkdir(out, { recursive: true });
await build({
  absWorkingDir: here,
  entryPoints: { console: "src/main.tsx" },
  outdir: out,
  bundle: true,
  minify: true,
  charset: "utf8",
  format: "iife",
  target: "es2022",
  jsx: "automatic",
  jsxImportSource: "preact",
  legalComments: "none",
  banner: { js: "/*! The console's page. Sources: viewer/console/page. Contains Preact:" + `\n${license.trim()}\n*/` },
  logLevel: "warning",
});
await build({
  absWorkingDir: here,
  entryPoints: { console: "src/console.css" },
  outdir: out,
  minify: true,
  charset: "utf8",
  logLevel: "warning",
});
await copyFile(path.join(here, "src", "index.html"), path.join(out, "index.html"));
