// Decodes the bytes of a buffer view that EXT_meshopt_compression of glTF holds, version 0 of vertices, 1 of triangles.
//
//   vertices   differences of each byte from that of the vertex before, 16 vertices a group
//   triangles  by an edge and a vertex among those that occurred shortly before

/// The decoded bytes; throws if the stream is damaged.
export function decode(stream, { mode, count, byteStride }) {
  if (mode === "ATTRIBUTES") return vertices(stream, count, byteStride);
  if (mode === "TRIANGLES") return triangles(stream, count, byteStride);
  throw new Error(`no decoder of ${mode}`);
}

function vertices(stream, count, stride) {
  if (stream[0] !== 0xa0) throw new Error("another header of vertices");
  const out = new Uint8Array(count * stride);
  const last = stream.slice(stream.length - stride);
  const blockSize = Math.min(Math.floor(8192 / stride) & ~15, 256);
  const group = new Uint8Array(16);
  let at = 1;
  for (let first = 0; first < count; first += blockSize) {
    const end = Math.min(first + blockSize, count);
    for (let place = 0; place < stride; place++) {
      const modes = at;
      const groups = Math.ceil((end - first) / 16);
      at += Math.ceil(groups / 4);
      for (let number = 0; number < groups; number++) {
        const bits = [0, 2, 4, 8][(stream[modes + (number >> 2)] >> (2 * (number & 3))) & 3];
        at = readGroup(stream, at, bits, group);
        const start = first + 16 * number;
        for (let vertex = start; vertex < Math.min(start + 16, end); vertex++) {
          const code = group[vertex - start];
          last[place] += code & 1 ? ~(code >> 1) : code >> 1;
          out[vertex * stride + place] = last[place];
        }
      }
    }
  }
  if (at !== stream.length - Math.max(stride, 32)) throw new Error("damaged vertices");
  return out;
}

/// Reads the 16 differences of a group; returns where the next one starts.
function readGroup(stream, at, bits, group) {
  if (bits === 0) {
    group.fill(0);
    return at;
  }
  const most = bits === 8 ? 256 : (1 << bits) - 1;
  const packed = at;
  at += 2 * bits;
  for (let number = 0; number < 16; number++) {
    const bit = number * bits;
    group[number] = (stream[packed + (bit >> 3)] >> (8 - bits - (bit & 7))) & ((1 << bits) - 1);
    if (group[number] === most) group[number] = stream[at++];
  }
  return at;
}

function triangles(stream, count, stride) {
  if (stream[0] !== 0xe1) throw new Error("another header of triangles");
  const out = stride === 2 ? new Uint16Array(count) : new Uint32Array(count);
  const table = stream.length - 16;
  const edges = new Uint32Array(32), recent = new Uint32Array(16);
  let edgeCount = 0, recentCount = 0, next = 0, last = 0, at = 1 + count / 3;
  const addEdge = (from, to) => {
    edges[2 * (edgeCount & 15)] = from;
    edges[2 * (edgeCount++ & 15) + 1] = to;
  };
  const addVertex = vertex => recent[recentCount++ & 15] = vertex;
  const explicit = () => {
    let number = 0, byte, shift = 0;
    do {
      byte = stream[at++];
      number |= (byte & 127) << shift;
      shift += 7;
    } while (byte > 127 && shift < 35);
    last = (last + (number & 1 ? ~(number >>> 1) : number >>> 1)) >>> 0;
    return last;
  };
  for (let number = 0; number < count; number += 3) {
    const code = stream[1 + number / 3];
    let a, b, c;
    if (code < 0xf0) {
      const edge = 2 * ((edgeCount - 1 - (code >> 4)) & 15), third = code & 15;
      [a, b] = [edges[edge], edges[edge + 1]];
      if (third === 0) c = next++;
      else if (third < 13) c = recent[(recentCount - 1 - third) & 15];
      else if (third < 15) c = last = (last + (third === 13 ? -1 : 1)) >>> 0;
      else c = explicit();
      if (third === 0 || third > 12) addVertex(c);
    } else {
      const pair = code < 0xfe ? stream[table + (code & 15)] : stream[at++];
      if (code >= 0xfe && pair === 0) next = 0;
      const [second, third] = [pair >> 4, pair & 15];
      const known = place => place === 0 ? next++ : recent[(recentCount - place) & 15];
      if (code !== 0xff) a = next++;
      if (second !== 15) b = known(second);
      if (third !== 15) c = known(third);
      a ??= explicit();
      b ??= explicit();
      c ??= explicit();
      addVertex(a);
      if (second === 0 || second === 15) addVertex(b);
      if (third === 0 || third === 15) addVertex(c);
      addEdge(b, a);
    }
    addEdge(c, b);
    addEdge(a, c);
    out.set([a, b, c], number);
  }
  if (at !== table) throw new Error("damaged triangles");
  return new Uint8Array(out.buffer);
}
