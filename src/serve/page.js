// Draws a folder of tiles: loads the tileset, chooses tiles by their error, reads GLBs as drystone writes them.
//
//   tileset.json ──▶ tree of tiles ── error of each in pixels ──▶ tiles to draw ── GLB ──▶ buffers, texture
//
// Places are those of the scene, in which z points up; the transform of the tileset is left out.

import { decode } from "./meshopt.js";

const REQUESTS_MAX = 6;
const TILES_KEPT = 400;
const FIELD = Math.PI / 4;
const COLOURS = [[0.85, 0.37, 0.01], [0.46, 0.44, 0.7], [0.4, 0.65, 0.12], [0.9, 0.67, 0.01], [0.1, 0.62, 0.47], [0.9, 0.16, 0.54]];

const element = id => document.getElementById(id);
const canvas = element("view");
const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
if (!gl) throw new Error("this browser has no WebGL 2");

// ---- tileset

class Tile {
  constructor(json, parent) {
    const [x, y, z, a, , , , b, , , , c] = json.boundingVolume.box;
    this.middle = [x, y, z];
    this.half = [a, b, c];
    this.error = json.geometricError;
    this.name = json.content?.uri;
    this.isTileset = this.name?.endsWith(".json") ?? false;
    this.level = this.name && !this.isTileset ? Number(this.name.split("/")[0]) : parent?.level;
    this.children = (json.children ?? []).map(child => new Tile(child, this));
    this.state = this.name ? "unknown" : "empty";
    this.used = 0;
  }

  /// Distance of a place from the box.
  distance(place) {
    return Math.hypot(...place.map((at, axis) => Math.max(0, Math.abs(at - this.middle[axis]) - this.half[axis])));
  }

  /// Whether it can be drawn, or has nothing to draw.
  get isReady() {
    return this.state === "ready" || this.state === "empty";
  }
}

let root, top = 0;
const waiting = new Map();
let busy = 0;

function want(tile, urgency) {
  if (tile.state === "unknown") waiting.set(tile, Math.max(urgency, waiting.get(tile) ?? 0));
}

function loadNext() {
  const sorted = [...waiting].sort((a, b) => b[1] - a[1]);
  waiting.clear();
  for (const [tile] of sorted.slice(0, REQUESTS_MAX - busy)) load(tile);
}

async function load(tile) {
  tile.state = "loading";
  busy++;
  try {
    const response = await fetch(`tiles/${tile.name}`);
    if (!response.ok) throw new Error(`${tile.name}: ${response.status}`);
    if (tile.isTileset) {
      tile.children = [new Tile((await response.json()).root, tile)];
      tile.state = "empty";
    } else {
      tile.mesh = await meshOf(await response.arrayBuffer());
      tile.state = "ready";
    }
  } catch (error) {
    tile.state = "failed";
    console.error(error.message);
  }
  busy--;
}

// ---- GLB

async function meshOf(bytes) {
  const view = new DataView(bytes);
  const jsonBytes = view.getUint32(12, true);
  const json = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 20, jsonBytes)));
  const start = 28 + jsonBytes;
  const part = number => {
    const own = json.bufferViews[number];
    const compressed = own.extensions?.EXT_meshopt_compression;
    const { byteOffset = 0, byteLength } = compressed ?? own;
    const stored = new Uint8Array(bytes, start + byteOffset, byteLength);
    return compressed ? decode(stored, compressed) : stored;
  };
  const [primitive] = json.meshes[0].primitives;
  const accessor = number => json.accessors[number];
  const positions = accessor(primitive.attributes.POSITION);
  const texcoords = accessor(primitive.attributes.TEXCOORD_0 ?? -1);
  const indices = accessor(primitive.indices);
  const node = json.nodes[0];
  const [x, up, south] = node.translation;
  const wide = indices.componentType === gl.UNSIGNED_INT;
  const raw = part(indices.bufferView).slice();
  const corners = wide ? new Uint32Array(raw.buffer, 0, indices.count) : new Uint16Array(raw.buffer, 0, indices.count);
  const skirt = 3 * (json.meshes[0].extras?.skirtTriangles ?? 0);

  const mesh = { count: indices.count, bare: indices.count - skirt, kind: indices.componentType, step: node.scale[0] };
  mesh.middle = [x, -south, up];
  mesh.triangles = indices.count / 3;
  const stride = json.bufferViews[0].byteStride;
  mesh.vertices = buffer(gl.ARRAY_BUFFER, part(0));
  mesh.array = (elements) => {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, mesh.vertices);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, positions.componentType, false, stride, 0);
    if (texcoords) {
      gl.enableVertexAttribArray(1);
      gl.vertexAttribPointer(1, 2, gl.UNSIGNED_SHORT, true, stride, texcoords.byteOffset);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, elements);
    gl.bindVertexArray(null);
    return array;
  };
  mesh.elements = buffer(gl.ELEMENT_ARRAY_BUFFER, corners);
  mesh.solid = mesh.array(mesh.elements);
  mesh.corners = corners;
  // The page has no decoder of KTX2: such a tile is shown without its texture.
  if (json.images && json.images[0].mimeType !== "image/ktx2") {
    const { bufferView, mimeType } = json.images[0];
    const image = await createImageBitmap(new Blob([part(bufferView)], { type: mimeType }), { colorSpaceConversion: "none" });
    mesh.texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, mesh.texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, image);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    image.close();
  }
  return mesh;
}

function buffer(kind, bytes) {
  const made = gl.createBuffer();
  gl.bindVertexArray(null);
  gl.bindBuffer(kind, made);
  gl.bufferData(kind, bytes, gl.STATIC_DRAW);
  return made;
}

/// The edges of the triangles without the skirt, made when they are first drawn.
function wiresOf(mesh) {
  if (!mesh.wires) {
    const edges = new mesh.corners.constructor(2 * mesh.bare);
    for (let at = 0; at < mesh.bare; at++) {
      const next = at % 3 === 2 ? at - 2 : at + 1;
      [edges[2 * at], edges[2 * at + 1]] = [mesh.corners[at], mesh.corners[next]];
    }
    mesh.edges = buffer(gl.ELEMENT_ARRAY_BUFFER, edges);
    mesh.wires = mesh.array(mesh.edges);
  }
  return mesh.wires;
}

function forget(tile) {
  const { mesh } = tile;
  [mesh.vertices, mesh.elements, mesh.edges].forEach(made => made && gl.deleteBuffer(made));
  [mesh.solid, mesh.wires].forEach(array => array && gl.deleteVertexArray(array));
  if (mesh.texture) gl.deleteTexture(mesh.texture);
  tile.mesh = undefined;
  tile.state = "unknown";
}

// ---- choice

const camera = { target: [0, 0, 0], distance: 1, turn: 0.6, tilt: 0.7 };
let frameNumber = 0, chosen = [];

function place() {
  const { target, distance, turn, tilt } = camera;
  const flat = distance * Math.cos(tilt);
  return [target[0] + flat * Math.sin(turn), target[1] - flat * Math.cos(turn), target[2] + distance * Math.sin(tilt)];
}

/// Adds the tiles to draw in and below a tile; returns whether all of them are ready.
function choose(tile, eye, list) {
  const pixels = tile.error * canvas.height / (2 * Math.tan(FIELD / 2) * Math.max(tile.distance(eye), 1e-9));
  const forced = Number(element("level").value);
  const isFine = forced < 0 ? pixels <= 2 ** Number(element("error").value) : (tile.level ?? Infinity) <= forced;
  if (tile.name) want(tile, pixels);
  tile.used = frameNumber;
  const ends = tile.children.length === 0 || (isFine && !tile.isTileset && tile.state !== "empty");
  if (!ends) {
    const below = [];
    const states = tile.children.map(child => choose(child, eye, below));
    // Until all children are there, their parent is shown.
    if (states.every(Boolean) || tile.state !== "ready") {
      list.push(...below);
      return states.every(Boolean) && tile.isReady;
    }
  }
  if (tile.state === "ready") list.push(tile);
  return tile.isReady;
}

// ---- drawing

function compile(kind, text) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, `#version 300 es\nprecision highp float;\n${text}`);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
  return shader;
}

const program = gl.createProgram();
gl.attachShader(program, compile(gl.VERTEX_SHADER, `
  layout(location = 0) in vec3 position;
  layout(location = 1) in vec2 texcoord;
  uniform mat4 to_view, to_screen;
  out vec2 at;
  out vec3 seen;
  void main() {
    vec4 placed = to_view * vec4(position, 1.0);
    at = texcoord;
    seen = placed.xyz;
    gl_Position = to_screen * placed;
  }`));
gl.attachShader(program, compile(gl.FRAGMENT_SHADER, `
  uniform sampler2D image;
  uniform float has_image;
  uniform vec4 tint;
  in vec2 at;
  in vec3 seen;
  out vec4 colour;
  void main() {
    vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
    vec3 own = has_image > 0.5 ? texture(image, at).rgb : vec3(0.8) * (0.35 + 0.65 * abs(normal.z));
    colour = vec4(mix(own, tint.rgb, tint.a), 1.0);
  }`));
gl.linkProgram(program);
if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
const uniform = name => gl.getUniformLocation(program, name);
const [TO_VIEW, TO_SCREEN, HAS_IMAGE, TINT] = ["to_view", "to_screen", "has_image", "tint"].map(uniform);

function axes() {
  const { turn, tilt } = camera;
  const right = [Math.cos(turn), Math.sin(turn), 0];
  const back = [Math.cos(tilt) * Math.sin(turn), -Math.cos(tilt) * Math.cos(turn), Math.sin(tilt)];
  const up = [
    back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2], back[0] * right[1] - back[1] * right[0],
  ];
  return [right, up, back];
}

function draw(eye) {
  const frame = axes();
  const far = camera.distance + 4 * Math.hypot(...root.half), near = Math.max(camera.distance / 200, far / 2e5);
  const zoom = 1 / Math.tan(FIELD / 2);
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.clearColor(0.87, 0.9, 0.92, 1);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.enable(gl.DEPTH_TEST);
  gl.useProgram(program);
  gl.uniformMatrix4fv(TO_SCREEN, false, [
    zoom * canvas.height / canvas.width, 0, 0, 0, 0, zoom, 0, 0,
    0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0,
  ]);
  const coloured = element("colours").checked, wired = element("wires").checked;
  for (const { mesh, level } of chosen) {
    // In double precision, so that tiles far from the origin do not tremble.
    const shift = mesh.middle.map((at, axis) => at - eye[axis]);
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const column = axis => frame.map(own => own[axis] * mesh.step);
    gl.uniformMatrix4fv(TO_VIEW, false, [
      ...column(0), 0, ...column(1), 0, ...column(2), 0, ...frame.map(own => dot(own, shift)), 1,
    ]);
    gl.uniform1f(HAS_IMAGE, mesh.texture ? 1 : 0);
    if (mesh.texture) gl.bindTexture(gl.TEXTURE_2D, mesh.texture);
    gl.uniform4f(TINT, ...COLOURS[level % COLOURS.length], coloured ? 0.5 : 0);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    gl.bindVertexArray(mesh.solid);
    gl.drawElements(gl.TRIANGLES, mesh.count, mesh.kind, 0);
    if (wired) {
      gl.uniform4f(TINT, 0.1, 0.1, 0.1, 1);
      gl.bindVertexArray(wiresOf(mesh));
      gl.drawElements(gl.LINES, 2 * mesh.bare, mesh.kind, 0);
    }
  }
  gl.bindVertexArray(null);
}

function tell() {
  const forced = Number(element("level").value);
  element("pixels").value = Math.round(2 ** Number(element("error").value));
  element("level-name").value = forced < 0 ? "by error" : forced;
  const triangles = chosen.reduce((sum, tile) => sum + tile.mesh.triangles, 0);
  element("shown").value = `${chosen.length} tiles, ${triangles.toLocaleString("en")} triangles`;
  const rows = [];
  for (let level = top; level >= 0; level--) {
    const own = chosen.filter(tile => tile.level === level);
    rows.push(`<tr><td>${level}<td>${known[level]?.tiles ?? ""}<td>${(known[level]?.error ?? 0).toPrecision(3)}<td>${own.length}`);
  }
  element("levels").innerHTML = rows.join("");
  window.shown = { tiles: chosen.length, triangles, busy: busy + waiting.size, levels: chosen.map(tile => tile.level) };
}

/// Tiles and the largest error of each level, of what is loaded of the tileset.
let known = [];
function count() {
  known = [];
  const visit = tile => {
    if (tile.name && !tile.isTileset) {
      const level = known[tile.level] ??= { tiles: 0, error: 0 };
      level.tiles++;
      level.error = Math.max(level.error, tile.error);
    }
    tile.children.forEach(visit);
  };
  visit(root);
}

function frame() {
  frameNumber++;
  [canvas.width, canvas.height] = [canvas.clientWidth, canvas.clientHeight];
  const eye = place();
  if (!element("still").checked) {
    chosen = [];
    choose(root, eye, chosen);
  }
  chosen = chosen.filter(tile => tile.mesh);
  draw(eye);
  if (frameNumber % 15 === 1) {
    count();
    const kept = [];
    const visit = tile => { if (tile.state === "ready") kept.push(tile); tile.children.forEach(visit); };
    visit(root);
    kept.sort((a, b) => b.used - a.used).slice(TILES_KEPT).filter(tile => !chosen.includes(tile)).forEach(forget);
  }
  tell();
  loadNext();
  requestAnimationFrame(frame);
}

// ---- hands

let held;
canvas.addEventListener("pointerdown", event => {
  held = { x: event.clientX, y: event.clientY, moves: event.button === 2 || event.shiftKey };
  canvas.setPointerCapture(event.pointerId);
});
canvas.addEventListener("pointerup", () => held = undefined);
canvas.addEventListener("pointermove", event => {
  if (!held) return;
  const [dx, dy] = [event.clientX - held.x, event.clientY - held.y];
  [held.x, held.y] = [event.clientX, event.clientY];
  if (held.moves) {
    const [right, up] = axes();
    const scale = 2 * camera.distance * Math.tan(FIELD / 2) / canvas.height;
    camera.target = camera.target.map((at, axis) => at + scale * (up[axis] * dy - right[axis] * dx));
  } else {
    camera.turn -= dx * 0.006;
    camera.tilt = Math.min(1.55, Math.max(-1.55, camera.tilt + dy * 0.006));
  }
});
canvas.addEventListener("wheel", event => {
  event.preventDefault();
  camera.distance *= Math.exp(event.deltaY * 0.001);
}, { passive: false });
canvas.addEventListener("contextmenu", event => event.preventDefault());

const tileset = await (await fetch("tiles/tileset.json")).json();
root = new Tile(tileset.root);
top = root.level ?? Math.max(0, ...root.children.map(child => child.level ?? 0));
element("level").max = top;
camera.target = [...root.middle];
camera.distance = 2.2 * Math.hypot(...root.half) * Number(new URLSearchParams(location.search).get("distance") ?? 1);
frame();
