// Shows a tileset in a page of this folder in headless Chromium, from one or more distances. Prints a line for each,
// what the page selects there, and writes a picture of each, PICTURES/DISTANCE.png.
//
//   node view.mjs TILESET-FOLDER MODULES PAGE PICTURES DISTANCE...   ──▶   {"tiles": …, "triangles": …, "errors": […]}
import { createRequire } from "node:module";
import fs from "node:fs";
import http from "node:http";
import path from "node:path";

const [tiles, modules, page, pictures, ...distances] = process.argv.slice(2);
const { chromium } = createRequire(path.join(modules, "x"))("playwright-core");
const types = { ".html": "text/html", ".js": "text/javascript", ".json": "application/json", ".css": "text/css",
  ".glb": "model/gltf-binary", ".wasm": "application/wasm" };
const roots = { tiles, modules, page: import.meta.dirname };
const server = http.createServer((request, response) => {
  const [, root, ...parts] = decodeURIComponent(request.url.split("?")[0]).split("/");
  const file = path.join(roots[root] ?? "/nonexistent", ...parts.filter(part => part !== ".."));
  fs.readFile(file, (error, bytes) => {
    response.writeHead(error ? 404 : 200, { "content-type": types[path.extname(file)] ?? "application/octet-stream" });
    response.end(bytes);
  });
});
await new Promise(resolve => server.listen(0, "127.0.0.1", resolve));
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--no-first-run"],
});
for (const distance of distances) {
  const errors = [];
  const view = await browser.newPage({ viewport: { width: 800, height: 600 } });
  view.on("console", message => message.type() === "error" && !message.location().url.endsWith("favicon.ico") && errors.push(message.text()));
  view.on("pageerror", error => errors.push(error.message));
  await view.goto(`http://127.0.0.1:${server.address().port}/page/${page}?distance=${distance}`);
  let shown, calm = 0;
  for (let turn = 0; turn < 240 && calm < 8; turn++) {
    await view.waitForTimeout(250);
    const now = await view.evaluate(() => window.shown);
    const isSame = now?.tiles > 0 && now.busy === 0 && JSON.stringify(now) === JSON.stringify(shown);
    [shown, calm] = [now, isSame ? calm + 1 : 0];
  }
  await view.screenshot({ path: path.join(pictures, `${distance}.png`) });
  await view.close();
  console.log(JSON.stringify({ ...shown, errors }));
}
await browser.close();
server.close();
